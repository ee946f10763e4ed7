/* The model as an FMU of FMI 2.0: model exchange, and co-simulation whose step integrates the states, where there are some.

   What a value reference means is in model.h. Outputs are computed when one is asked for and something has changed since. */
#include "fmi2.h"
#include "model.h"

#include <stdlib.h>
#include <string.h>

typedef struct {
    thermohyd_model now;
    fmi2CallbackFunctions host;
    char *name;
    int logging;
} instance;

static void say(const instance *it, fmi2Status status, fmi2String message) {
    if (it->host.logger) it->host.logger(it->host.componentEnvironment, it->name, status, "thermohyd", message);
}

static fmi2Status refuse(const instance *it, fmi2String message) { say(it, fmi2Error, message); return fmi2Error; }

/* The status of what ended with this code. */
static fmi2Status ended(const instance *it, int code) {
    if (code == THERMOHYD_OK) return fmi2OK;
    if (code != THERMOHYD_NO_SUPPLY || THERMOHYD_STATES) return refuse(it, thermohyd_words(code));
    if (it->logging) say(it, fmi2Warning, thermohyd_words(code));
    return fmi2OK;
}

EXPORTED const char *FMI(fmi2GetTypesPlatform)(void) { return "default"; }
EXPORTED const char *FMI(fmi2GetVersion)(void) { return "2.0"; }

EXPORTED fmi2Component FMI(fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                            const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging) {
    (void)type; (void)resources; (void)visible;
    if (!host || !name) return NULL;
    void *(*allocate)(size_t, size_t) = host->allocateMemory ? host->allocateMemory : calloc;
    instance *it = allocate(1, sizeof *it);
    if (!it) return NULL;
    memset(it, 0, sizeof *it);
    it->host = *host;
    it->logging = logging;
    it->name = allocate(strlen(name) + 1, 1);
    if (it->name) strcpy(it->name, name);
    thermohyd_start(&it->now);
    if (!it->name || !guid || strcmp(guid, THERMOHYD_GUID)) {
        if (it->name) say(it, fmi2Error, "the GUID is not that of this model");
        void (*release)(void *) = host->freeMemory ? host->freeMemory : free;
        if (it->name) release(it->name);
        release(it);
        return NULL;
    }
    return it;
}

EXPORTED void FMI(fmi2FreeInstance)(fmi2Component c) {
    instance *it = c;
    if (!it) return;
    void (*release)(void *) = it->host.freeMemory ? it->host.freeMemory : free;
    release(it->name);
    release(it);
}

EXPORTED fmi2Status FMI(fmi2SetDebugLogging)(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)n; (void)categories;
    ((instance *)c)->logging = on;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2SetupExperiment)(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real begin,
                                             fmi2Boolean ends, fmi2Real end) {
    (void)ends; (void)end;
    ((instance *)c)->now.time = begin;
    if (tolerant && tolerance > 0.0) ((instance *)c)->now.tolerance = tolerance;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2EnterInitializationMode)(fmi2Component c) { (void)c; return fmi2OK; }
EXPORTED fmi2Status FMI(fmi2ExitInitializationMode)(fmi2Component c) {
    return ended(c, thermohyd_settle(&((instance *)c)->now));
}
EXPORTED fmi2Status FMI(fmi2Terminate)(fmi2Component c) { (void)c; return fmi2OK; }

EXPORTED fmi2Status FMI(fmi2Reset)(fmi2Component c) {
    instance *it = c;
    thermohyd_start(&it->now);
    return fmi2OK;
}

/* ---- values ---- */

EXPORTED fmi2Status FMI(fmi2GetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    instance *it = c;
    int computed = 0;
    for (size_t i = 0; i < n; i++) {
        int found = thermohyd_get(&it->now, vr[i], value + i);
        if (!found) return refuse(it, "fmi2GetReal: no real variable has this value reference");
        if (found < 0) return ended(it, it->now.code);
        computed |= vr[i] >= FIRST_OUTPUT;
    }
    return computed ? ended(it, it->now.code) : fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2SetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    instance *it = c;
    for (size_t i = 0; i < n; i++) {
        int done = thermohyd_set(&it->now, vr[i], value[i]);
        if (done < 0) return refuse(it, "fmi2SetReal: parameters are fixed once the model is initialised");
        if (!done) return refuse(it, "fmi2SetReal: neither a parameter nor an input has this value reference");
    }
    return fmi2OK;
}

#define NONE_OF(Kind, type)                                                                                                   \
    EXPORTED fmi2Status FMI(fmi2Get##Kind)(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[]) {           \
        (void)vr; (void)value;                                                                                                \
        return n ? refuse(c, "fmi2Get" #Kind ": all variables are real") : fmi2OK;                                             \
    }                                                                                                                         \
    EXPORTED fmi2Status FMI(fmi2Set##Kind)(fmi2Component c, const fmi2ValueReference vr[], size_t n, const type value[]) {     \
        (void)vr; (void)value;                                                                                                \
        return n ? refuse(c, "fmi2Set" #Kind ": all variables are real") : fmi2OK;                                             \
    }
NONE_OF(Integer, fmi2Integer)
NONE_OF(Boolean, fmi2Boolean)
NONE_OF(String, fmi2String)

EXPORTED fmi2Status FMI(fmi2GetFMUstate)(fmi2Component c, fmi2FMUstate *state) {
    instance *it = c;
    if (!*state) *state = (it->host.allocateMemory ? it->host.allocateMemory : calloc)(1, sizeof(thermohyd_model));
    if (!*state) return refuse(it, "no memory");
    memcpy(*state, &it->now, sizeof(thermohyd_model));
    return fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2SetFMUstate)(fmi2Component c, fmi2FMUstate state) {
    memcpy(&((instance *)c)->now, state, sizeof(thermohyd_model));
    return fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2FreeFMUstate)(fmi2Component c, fmi2FMUstate *state) {
    instance *it = c;
    if (*state) (it->host.freeMemory ? it->host.freeMemory : free)(*state);
    *state = NULL;
    return fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2SerializedFMUstateSize)(fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)c; (void)state;
    *size = sizeof(thermohyd_model);
    return fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2SerializeFMUstate)(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    if (size < sizeof(thermohyd_model)) return refuse(c, "fmi2SerializeFMUstate: too few bytes");
    memcpy(bytes, state, sizeof(thermohyd_model));
    return fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2DeSerializeFMUstate)(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    if (size != sizeof(thermohyd_model)) return refuse(c, "fmi2DeSerializeFMUstate: not a state of this model");
    fmi2Status status = FMI(fmi2GetFMUstate)(c, state);
    if (status == fmi2OK) memcpy(*state, bytes, sizeof(thermohyd_model));
    return status;
}

EXPORTED fmi2Status FMI(fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference unknown[], size_t n,
                                                      const fmi2ValueReference known[], size_t k, const fmi2Real dv[], fmi2Real dz[]) {
    (void)unknown; (void)n; (void)known; (void)k; (void)dv; (void)dz;
    return refuse(c, "fmi2GetDirectionalDerivative: not provided");
}

/* ---- model exchange: no events ---- */

EXPORTED fmi2Status FMI(fmi2EnterEventMode)(fmi2Component c) { (void)c; return fmi2OK; }
EXPORTED fmi2Status FMI(fmi2NewDiscreteStates)(fmi2Component c, fmi2EventInfo *info) {
    (void)c;
    memset(info, 0, sizeof *info);
    return fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2EnterContinuousTimeMode)(fmi2Component c) { (void)c; return fmi2OK; }
EXPORTED fmi2Status FMI(fmi2CompletedIntegratorStep)(fmi2Component c, fmi2Boolean no_return, fmi2Boolean *event, fmi2Boolean *end) {
    (void)c; (void)no_return;
    *event = *end = fmi2False;
    return fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2SetTime)(fmi2Component c, fmi2Real time) { ((instance *)c)->now.time = time; return fmi2OK; }
EXPORTED fmi2Status FMI(fmi2SetContinuousStates)(fmi2Component c, const fmi2Real x[], size_t n) {
    if (n != THERMOHYD_STATES) return refuse(c, "fmi2SetContinuousStates: the model has another number of states");
    if (n) thermohyd_set_states(&((instance *)c)->now, x);
    return fmi2OK;
}
#define OF_STATES(name, values)                                                                                               \
    EXPORTED fmi2Status FMI(name)(fmi2Component c, fmi2Real x[], size_t n) {                                                  \
        thermohyd_model *m = &((instance *)c)->now;                                                                           \
        if (n != THERMOHYD_STATES) return refuse(c, #name ": the model has another number of states");                        \
        fmi2Status status = n ? ended(c, thermohyd_compute(m)) : fmi2OK;                                                      \
        if (n && status == fmi2OK) memcpy(x, values, n * sizeof *x);                                                          \
        return status;                                                                                                        \
    }
OF_STATES(fmi2GetDerivatives, m->rate)
OF_STATES(fmi2GetContinuousStates, m->state)
OF_STATES(fmi2GetNominalsOfContinuousStates, m->scale.size)
EXPORTED fmi2Status FMI(fmi2GetEventIndicators)(fmi2Component c, fmi2Real x[], size_t n) {
    (void)x;
    return n ? refuse(c, "the model has no event indicators") : fmi2OK;
}

/* ---- co-simulation ---- */

/* Of the first order, over the next step; then an input stays where it came to. */
EXPORTED fmi2Status FMI(fmi2SetRealInputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                     const fmi2Integer order[], const fmi2Real value[]) {
    if (n && !THERMOHYD_STATES) return refuse(c, "inputs are not interpolated: there is nothing to integrate");
    for (size_t i = 0; i < n; i++)
        if (order[i] != 1 || !thermohyd_set_slope(&((instance *)c)->now, vr[i], value[i]))
            return refuse(c, "fmi2SetRealInputDerivatives: of inputs, and of the first order");
    return fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2GetRealOutputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                      const fmi2Integer order[], fmi2Real value[]) {
    (void)vr; (void)order; (void)value;
    return n ? refuse(c, "outputs have no derivatives") : fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2DoStep)(fmi2Component c, fmi2Real from, fmi2Real step, fmi2Boolean no_return) {
    (void)no_return;
    instance *it = c;
    it->now.time = from;
    return ended(it, thermohyd_advance(&it->now, from + step));
}
EXPORTED fmi2Status FMI(fmi2CancelStep)(fmi2Component c) { return refuse(c, "a step is over when fmi2DoStep returns"); }
EXPORTED fmi2Status FMI(fmi2GetStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    (void)c; (void)kind; (void)value;
    return fmi2Discard; /* of asynchronous steps alone */
}
EXPORTED fmi2Status FMI(fmi2GetRealStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = ((instance *)c)->now.time;
    return fmi2OK;
}
#define NO_STATUS(name, type)                                                                                                 \
    EXPORTED fmi2Status FMI(name)(fmi2Component c, const fmi2StatusKind kind, type *value) {                                  \
        (void)c; (void)kind; (void)value;                                                                                     \
        return fmi2Discard;                                                                                                   \
    }
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetStringStatus, fmi2String)
EXPORTED fmi2Status FMI(fmi2GetBooleanStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    (void)c;
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = fmi2False;
    return fmi2OK;
}
