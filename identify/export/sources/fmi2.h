/* What an FMU of FMI 2.0.4 (fmi-standard.org) offers: types, states and functions, as far as this one defines them. */
#ifndef THERMOHYD_FMI2_H
#define THERMOHYD_FMI2_H

#include <stddef.h>

/* A host that links the sources into itself asks for names of their own: -DFMI2_FUNCTION_PREFIX=name_ */
#ifdef FMI2_FUNCTION_PREFIX
#define THERMOHYD_JOINED(a, b) a##b
#define THERMOHYD_JOIN(a, b) THERMOHYD_JOINED(a, b)
#define FMI(name) THERMOHYD_JOIN(FMI2_FUNCTION_PREFIX, name)
#define EXPORTED
#elif defined(_WIN32)
#define FMI(name) name
#define EXPORTED __declspec(dllexport)
#elif defined(__GNUC__)
#define FMI(name) name
#define EXPORTED __attribute__((visibility("default")))
#else
#define FMI(name) name
#define EXPORTED
#endif

typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef char fmi2Char, fmi2Byte;
typedef const fmi2Char *fmi2String;
enum { fmi2False, fmi2True };
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;

typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String instance, fmi2Status, fmi2String category, fmi2String message, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

typedef struct {
    fmi2Boolean newDiscreteStatesNeeded, terminateSimulation, nominalsOfContinuousStatesChanged,
        valuesOfContinuousStatesChanged, nextEventTimeDefined;
    fmi2Real nextEventTime;
} fmi2EventInfo;

#endif
