/* What an FMU of FMI 3.0 (fmi-standard.org) offers: types and functions, as far as this one defines them. */
#ifndef THERMOHYD_FMI3_H
#define THERMOHYD_FMI3_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A host that links the sources into itself asks for names of their own: -DFMI3_FUNCTION_PREFIX=name_ */
#ifdef FMI3_FUNCTION_PREFIX
#define THERMOHYD_JOINED(a, b) a##b
#define THERMOHYD_JOIN(a, b) THERMOHYD_JOINED(a, b)
#define FMI(name) THERMOHYD_JOIN(FMI3_FUNCTION_PREFIX, name)
#define EXPORTED
#else
#define FMI(name) name
#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORTED __attribute__((visibility("default")))
#else
#define EXPORTED
#endif
#endif

typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef double fmi3Float64;
typedef bool fmi3Boolean;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String category, fmi3String message);
typedef void (*fmi3Callback)(void); /* those that are never called */

#endif
