/* The model as an FMU of FMI 3.0: model exchange, and co-simulation whose step integrates the states, where there are some.

   What a value reference means is in model.h; that of time is OF_TIME. Inputs stand over a step: this version has no slopes of them. */
#include "fmi3.h"
#include "model.h"

#include <stdlib.h>
#include <string.h>

#define OF_TIME 4000u

typedef struct {
    thermohyd_model now;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment host;
    bool logging;
} instance;

static fmi3Status refuse(fmi3Instance it, fmi3String message) {
    instance *own = it;
    if (own->log) own->log(own->host, fmi3Error, "thermohyd", message);
    return fmi3Error;
}

/* The status of what ended with this code. */
static fmi3Status ended(fmi3Instance it, int code) {
    instance *own = it;
    if (code == THERMOHYD_OK) return fmi3OK;
    if (code != THERMOHYD_NO_SUPPLY || THERMOHYD_STATES) return refuse(it, thermohyd_words(code));
    if (own->logging && own->log) own->log(own->host, fmi3Warning, "thermohyd", thermohyd_words(code));
    return fmi3OK;
}

static thermohyd_model *model_of(fmi3Instance it) { return &((instance *)it)->now; }

/* ---- instances ---- */

static fmi3Instance instantiated(fmi3String token, bool logging, fmi3InstanceEnvironment host, fmi3LogMessageCallback log) {
    instance *it = calloc(1, sizeof *it);
    if (!it) return NULL;
    it->log = log;
    it->host = host;
    it->logging = logging;
    if (!token || strcmp(token, THERMOHYD_GUID)) {
        refuse(it, "the instantiation token is not that of this model");
        free(it);
        return NULL;
    }
    thermohyd_start(&it->now);
    return it;
}

EXPORTED const char *FMI(fmi3GetVersion)(void) { return "3.0"; }

EXPORTED fmi3Instance FMI(fmi3InstantiateModelExchange)(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                                        fmi3Boolean logging, fmi3InstanceEnvironment host, fmi3LogMessageCallback log) {
    (void)name; (void)resources; (void)visible;
    return instantiated(token, logging, host, log);
}
EXPORTED fmi3Instance FMI(fmi3InstantiateCoSimulation)(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                                       fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                                       const fmi3ValueReference between[], size_t n, fmi3InstanceEnvironment host,
                                                       fmi3LogMessageCallback log, fmi3Callback update) {
    (void)name; (void)resources; (void)visible; (void)events; (void)early; (void)between; (void)n; (void)update;
    return instantiated(token, logging, host, log);
}
EXPORTED fmi3Instance FMI(fmi3InstantiateScheduledExecution)(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                                             fmi3Boolean logging, fmi3InstanceEnvironment host, fmi3LogMessageCallback log,
                                                             fmi3Callback clock, fmi3Callback lock, fmi3Callback unlock) {
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)clock; (void)lock; (void)unlock;
    if (log) log(host, fmi3Error, "thermohyd", "the model has no scheduled execution");
    return NULL;
}
EXPORTED void FMI(fmi3FreeInstance)(fmi3Instance it) { free(it); }

EXPORTED fmi3Status FMI(fmi3SetDebugLogging)(fmi3Instance it, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    (void)n; (void)categories;
    ((instance *)it)->logging = on;
    return fmi3OK;
}

EXPORTED fmi3Status FMI(fmi3EnterInitializationMode)(fmi3Instance it, fmi3Boolean tolerant, fmi3Float64 tolerance, fmi3Float64 begin,
                                                     fmi3Boolean ends, fmi3Float64 end) {
    (void)ends; (void)end;
    model_of(it)->time = begin;
    if (tolerant && tolerance > 0.0) model_of(it)->tolerance = tolerance;
    return fmi3OK;
}
EXPORTED fmi3Status FMI(fmi3ExitInitializationMode)(fmi3Instance it) { return ended(it, thermohyd_settle(model_of(it))); }
EXPORTED fmi3Status FMI(fmi3Reset)(fmi3Instance it) {
    thermohyd_start(model_of(it));
    return fmi3OK;
}

/* ---- values ---- */

EXPORTED fmi3Status FMI(fmi3GetFloat64)(fmi3Instance it, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[], size_t size) {
    int computed = 0;
    if (n != size) return refuse(it, "fmi3GetFloat64: all variables are scalars");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == OF_TIME) { value[i] = model_of(it)->time; continue; }
        int found = thermohyd_get(model_of(it), vr[i], value + i);
        if (!found) return refuse(it, "fmi3GetFloat64: no variable has this value reference");
        if (found < 0) return ended(it, model_of(it)->code);
        computed |= vr[i] >= FIRST_OUTPUT;
    }
    return computed ? ended(it, model_of(it)->code) : fmi3OK;
}

EXPORTED fmi3Status FMI(fmi3SetFloat64)(fmi3Instance it, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[], size_t size) {
    if (n != size) return refuse(it, "fmi3SetFloat64: all variables are scalars");
    for (size_t i = 0; i < n; i++) {
        int done = thermohyd_set(model_of(it), vr[i], value[i]);
        if (done < 0) return refuse(it, "fmi3SetFloat64: parameters are fixed once the model is initialised");
        if (!done) return refuse(it, "fmi3SetFloat64: neither a parameter nor an input has this value reference");
    }
    return fmi3OK;
}

#define NONE_OF(Kind, type)                                                                                                   \
    EXPORTED fmi3Status FMI(fmi3Get##Kind)(fmi3Instance it, const fmi3ValueReference vr[], size_t n, type value[], size_t size) { \
        (void)vr; (void)value; (void)size;                                                                                    \
        return n ? refuse(it, "fmi3Get" #Kind ": all variables are of type Float64") : fmi3OK;                                 \
    }                                                                                                                         \
    EXPORTED fmi3Status FMI(fmi3Set##Kind)(fmi3Instance it, const fmi3ValueReference vr[], size_t n, const type value[],       \
                                           size_t size) {                                                                     \
        (void)vr; (void)value; (void)size;                                                                                    \
        return n ? refuse(it, "fmi3Set" #Kind ": all variables are of type Float64") : fmi3OK;                                 \
    }
NONE_OF(Float32, float)
NONE_OF(Int8, int8_t)
NONE_OF(UInt8, uint8_t)
NONE_OF(Int16, int16_t)
NONE_OF(UInt16, uint16_t)
NONE_OF(Int32, int32_t)
NONE_OF(UInt32, uint32_t)
NONE_OF(Int64, int64_t)
NONE_OF(UInt64, uint64_t)
NONE_OF(Boolean, fmi3Boolean)
NONE_OF(String, fmi3String)

EXPORTED fmi3Status FMI(fmi3GetBinary)(fmi3Instance it, const fmi3ValueReference vr[], size_t n, size_t sizes[], const fmi3Byte *value[],
                                       size_t size) {
    (void)vr; (void)sizes; (void)value; (void)size;
    return n ? refuse(it, "fmi3GetBinary: all variables are of type Float64") : fmi3OK;
}
EXPORTED fmi3Status FMI(fmi3SetBinary)(fmi3Instance it, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
                                       const fmi3Byte *const value[], size_t size) {
    (void)vr; (void)sizes; (void)value; (void)size;
    return n ? refuse(it, "fmi3SetBinary: all variables are of type Float64") : fmi3OK;
}

/* ---- what is saved and restored ---- */

EXPORTED fmi3Status FMI(fmi3GetFMUState)(fmi3Instance it, fmi3FMUState *state) {
    if (!*state) *state = malloc(sizeof(thermohyd_model));
    if (!*state) return refuse(it, "no memory");
    memcpy(*state, model_of(it), sizeof(thermohyd_model));
    return fmi3OK;
}
EXPORTED fmi3Status FMI(fmi3SetFMUState)(fmi3Instance it, fmi3FMUState state) {
    memcpy(model_of(it), state, sizeof(thermohyd_model));
    return fmi3OK;
}
EXPORTED fmi3Status FMI(fmi3FreeFMUState)(fmi3Instance it, fmi3FMUState *state) {
    (void)it;
    free(*state);
    *state = NULL;
    return fmi3OK;
}
EXPORTED fmi3Status FMI(fmi3SerializedFMUStateSize)(fmi3Instance it, fmi3FMUState state, size_t *size) {
    (void)it; (void)state;
    *size = sizeof(thermohyd_model);
    return fmi3OK;
}
EXPORTED fmi3Status FMI(fmi3SerializeFMUState)(fmi3Instance it, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    if (size < sizeof(thermohyd_model)) return refuse(it, "fmi3SerializeFMUState: too few bytes");
    memcpy(bytes, state, sizeof(thermohyd_model));
    return fmi3OK;
}
EXPORTED fmi3Status FMI(fmi3DeserializeFMUState)(fmi3Instance it, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    if (size != sizeof(thermohyd_model)) return refuse(it, "fmi3DeserializeFMUState: not a state of this model");
    fmi3Status status = FMI(fmi3GetFMUState)(it, state);
    if (status == fmi3OK) memcpy(*state, bytes, sizeof(thermohyd_model));
    return status;
}

/* ---- model exchange: no events ---- */

#define MODE(name) EXPORTED fmi3Status FMI(name)(fmi3Instance it) { (void)it; return fmi3OK; }
MODE(fmi3EnterEventMode)
MODE(fmi3EnterContinuousTimeMode)
MODE(fmi3EnterStepMode)
MODE(fmi3EnterConfigurationMode)
MODE(fmi3ExitConfigurationMode)
MODE(fmi3EvaluateDiscreteStates)
MODE(fmi3Terminate)

EXPORTED fmi3Status FMI(fmi3UpdateDiscreteStates)(fmi3Instance it, fmi3Boolean *again, fmi3Boolean *end, fmi3Boolean *nominals,
                                                  fmi3Boolean *values, fmi3Boolean *next, fmi3Float64 *when) {
    (void)it;
    *again = *end = *nominals = *values = *next = false;
    *when = 0.0;
    return fmi3OK;
}
EXPORTED fmi3Status FMI(fmi3CompletedIntegratorStep)(fmi3Instance it, fmi3Boolean no_return, fmi3Boolean *event, fmi3Boolean *end) {
    (void)it; (void)no_return;
    *event = *end = false;
    return fmi3OK;
}
EXPORTED fmi3Status FMI(fmi3SetTime)(fmi3Instance it, fmi3Float64 time) { model_of(it)->time = time; return fmi3OK; }
EXPORTED fmi3Status FMI(fmi3SetContinuousStates)(fmi3Instance it, const fmi3Float64 x[], size_t n) {
    if (n != THERMOHYD_STATES) return refuse(it, "fmi3SetContinuousStates: the model has another number of states");
    if (n) thermohyd_set_states(model_of(it), x);
    return fmi3OK;
}
#define OF_STATES(name, values)                                                                                               \
    EXPORTED fmi3Status FMI(name)(fmi3Instance it, fmi3Float64 x[], size_t n) {                                               \
        thermohyd_model *m = model_of(it);                                                                                    \
        if (n != THERMOHYD_STATES) return refuse(it, #name ": the model has another number of states");                       \
        fmi3Status status = n ? ended(it, thermohyd_compute(m)) : fmi3OK;                                                     \
        if (n && status == fmi3OK) memcpy(x, values, n * sizeof *x);                                                          \
        return status;                                                                                                        \
    }
OF_STATES(fmi3GetContinuousStateDerivatives, m->rate)
OF_STATES(fmi3GetContinuousStates, m->state)
OF_STATES(fmi3GetNominalsOfContinuousStates, m->scale.size)
EXPORTED fmi3Status FMI(fmi3GetEventIndicators)(fmi3Instance it, fmi3Float64 x[], size_t n) {
    (void)x;
    return n ? refuse(it, "the model has no event indicators") : fmi3OK;
}
EXPORTED fmi3Status FMI(fmi3GetNumberOfEventIndicators)(fmi3Instance it, size_t *n) { (void)it; *n = 0; return fmi3OK; }
EXPORTED fmi3Status FMI(fmi3GetNumberOfContinuousStates)(fmi3Instance it, size_t *n) {
    (void)it;
    *n = THERMOHYD_STATES;
    return fmi3OK;
}

/* ---- co-simulation ---- */

EXPORTED fmi3Status FMI(fmi3DoStep)(fmi3Instance it, fmi3Float64 from, fmi3Float64 step, fmi3Boolean no_return, fmi3Boolean *event,
                                    fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *reached) {
    (void)no_return;
    *event = *end = *early = false;
    model_of(it)->time = from;
    fmi3Status status = ended(it, thermohyd_advance(model_of(it), from + step));
    *reached = status == fmi3OK ? from + step : from;
    return status;
}

/* ---- not provided ---- */

#define NOT_PROVIDED(name, ...)                                                                                               \
    EXPORTED fmi3Status FMI(name)(fmi3Instance it, __VA_ARGS__) { return refuse(it, #name ": not provided"); }
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
#define REFERENCES const fmi3ValueReference vr[], size_t n
NOT_PROVIDED(fmi3GetOutputDerivatives, REFERENCES, const int32_t orders[], fmi3Float64 values[], size_t size)
NOT_PROVIDED(fmi3GetDirectionalDerivative, REFERENCES, const fmi3ValueReference known[], size_t k, const fmi3Float64 seed[], size_t s,
             fmi3Float64 found[], size_t f)
NOT_PROVIDED(fmi3GetAdjointDerivative, REFERENCES, const fmi3ValueReference known[], size_t k, const fmi3Float64 seed[], size_t s,
             fmi3Float64 found[], size_t f)
NOT_PROVIDED(fmi3GetNumberOfVariableDependencies, fmi3ValueReference vr, size_t *n)
NOT_PROVIDED(fmi3GetVariableDependencies, fmi3ValueReference vr, size_t own[], fmi3ValueReference others[], size_t of_others[], int kinds[],
             size_t n)
NOT_PROVIDED(fmi3GetClock, REFERENCES, bool values[])
NOT_PROVIDED(fmi3SetClock, REFERENCES, const bool values[])
NOT_PROVIDED(fmi3GetIntervalDecimal, REFERENCES, fmi3Float64 intervals[], int qualifiers[])
NOT_PROVIDED(fmi3GetIntervalFraction, REFERENCES, uint64_t counters[], uint64_t resolutions[], int qualifiers[])
NOT_PROVIDED(fmi3GetShiftDecimal, REFERENCES, fmi3Float64 shifts[])
NOT_PROVIDED(fmi3GetShiftFraction, REFERENCES, uint64_t counters[], uint64_t resolutions[])
NOT_PROVIDED(fmi3SetIntervalDecimal, REFERENCES, const fmi3Float64 intervals[])
NOT_PROVIDED(fmi3SetIntervalFraction, REFERENCES, const uint64_t counters[], const uint64_t resolutions[])
NOT_PROVIDED(fmi3SetShiftDecimal, REFERENCES, const fmi3Float64 shifts[])
NOT_PROVIDED(fmi3SetShiftFraction, REFERENCES, const uint64_t counters[], const uint64_t resolutions[])
NOT_PROVIDED(fmi3ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)
