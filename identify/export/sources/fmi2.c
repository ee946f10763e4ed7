/* The valve as an FMU: model exchange without states, and co-simulation whose step has nothing to integrate.

   Value references: parameters from 0, inputs from 1000, outputs from 2000, each in the order of its struct in valve.h. Outputs are
   computed when one is asked for and something has changed since. */
#include "fmi2.h"
#include "valve.h"

#include <stdlib.h>
#include <string.h>

#define PARAMETERS (sizeof(thermohyd_parameters) / sizeof(double))
#define INPUTS (sizeof(thermohyd_inputs) / sizeof(double))
#define OUTPUTS (sizeof(thermohyd_outputs) / sizeof(double))
#define FIRST_INPUT 1000u
#define FIRST_OUTPUT 2000u

typedef struct {
    thermohyd_parameters parameters;
    thermohyd_inputs inputs;
    thermohyd_outputs outputs;
    double time;
    int stale; /* outputs are those of other inputs */
    fmi2Status status; /* with which they were computed */
} content;

typedef struct {
    content now;
    fmi2CallbackFunctions host;
    char *name;
    int logging, settled; /* settled: initialisation is over, parameters are fixed */
} instance;

static void say(const instance *it, fmi2Status status, fmi2String message) {
    if (it->host.logger) it->host.logger(it->host.componentEnvironment, it->name, status, "thermohyd", message);
}

static fmi2Status refuse(const instance *it, fmi2String message) { say(it, fmi2Error, message); return fmi2Error; }

static void start(content *c) {
    const thermohyd_inputs inputs = {THERMOHYD_START_INPUTS};
    memset(c, 0, sizeof *c);
    thermohyd_defaults(&c->parameters);
    c->inputs = inputs;
    c->stale = 1;
}

static fmi2Status compute(instance *it) {
    content *c = &it->now;
    if (!c->stale) return c->status;
    c->status = fmi2OK;
    switch (thermohyd_valve(&c->parameters, &c->inputs, &c->outputs)) {
    case THERMOHYD_BAD_INPUT:
        c->status = refuse(it, "an input is no finite number, or the temperature is not between 150 and 700 K");
        break;
    case THERMOHYD_NO_SUPPLY:
        if (it->logging) say(it, fmi2Warning, "the return pressure lies above the supply pressure: blocked ports and load flow are NaN");
    }
    c->stale = c->status != fmi2OK;
    return c->status;
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
    start(&it->now);
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
    (void)tolerant; (void)tolerance; (void)ends; (void)end;
    ((instance *)c)->now.time = begin;
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2EnterInitializationMode)(fmi2Component c) { (void)c; return fmi2OK; }
EXPORTED fmi2Status FMI(fmi2ExitInitializationMode)(fmi2Component c) { ((instance *)c)->settled = 1; return fmi2OK; }
EXPORTED fmi2Status FMI(fmi2Terminate)(fmi2Component c) { (void)c; return fmi2OK; }

EXPORTED fmi2Status FMI(fmi2Reset)(fmi2Component c) {
    instance *it = c;
    start(&it->now);
    it->settled = 0;
    return fmi2OK;
}

/* ---- values ---- */

EXPORTED fmi2Status FMI(fmi2GetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    instance *it = c;
    const double *parameters = (const double *)&it->now.parameters, *inputs = (const double *)&it->now.inputs;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] < PARAMETERS) value[i] = parameters[vr[i]];
        else if (vr[i] >= FIRST_INPUT && vr[i] < FIRST_INPUT + INPUTS) value[i] = inputs[vr[i] - FIRST_INPUT];
        else if (vr[i] >= FIRST_OUTPUT && vr[i] < FIRST_OUTPUT + OUTPUTS) {
            fmi2Status status = compute(it);
            if (status != fmi2OK) return status;
            value[i] = ((const double *)&it->now.outputs)[vr[i] - FIRST_OUTPUT];
        } else return refuse(it, "fmi2GetReal: no real variable has this value reference");
    }
    return fmi2OK;
}

EXPORTED fmi2Status FMI(fmi2SetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    instance *it = c;
    for (size_t i = 0; i < n; i++) {
        double *place = NULL;
        if (vr[i] < PARAMETERS) {
            if (it->settled) return refuse(it, "fmi2SetReal: parameters are fixed once the model is initialised");
            place = (double *)&it->now.parameters + vr[i];
        } else if (vr[i] >= FIRST_INPUT && vr[i] < FIRST_INPUT + INPUTS)
            place = (double *)&it->now.inputs + (vr[i] - FIRST_INPUT);
        else return refuse(it, "fmi2SetReal: neither a parameter nor an input has this value reference");
        if (*place != value[i]) it->now.stale = 1;
        *place = value[i];
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
    if (!*state) *state = (it->host.allocateMemory ? it->host.allocateMemory : calloc)(1, sizeof(content));
    if (!*state) return refuse(it, "no memory");
    memcpy(*state, &it->now, sizeof(content));
    return fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2SetFMUstate)(fmi2Component c, fmi2FMUstate state) {
    memcpy(&((instance *)c)->now, state, sizeof(content));
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
    *size = sizeof(content);
    return fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2SerializeFMUstate)(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    if (size < sizeof(content)) return refuse(c, "fmi2SerializeFMUstate: too few bytes");
    memcpy(bytes, state, sizeof(content));
    return fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2DeSerializeFMUstate)(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    if (size != sizeof(content)) return refuse(c, "fmi2DeSerializeFMUstate: not a state of this model");
    fmi2Status status = FMI(fmi2GetFMUstate)(c, state);
    if (status == fmi2OK) memcpy(*state, bytes, sizeof(content));
    return status;
}

EXPORTED fmi2Status FMI(fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference unknown[], size_t n,
                                                      const fmi2ValueReference known[], size_t k, const fmi2Real dv[], fmi2Real dz[]) {
    (void)unknown; (void)n; (void)known; (void)k; (void)dv; (void)dz;
    return refuse(c, "fmi2GetDirectionalDerivative: not provided");
}

/* ---- model exchange: no states, no events ---- */

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
    (void)x;
    return n ? refuse(c, "the model has no continuous states") : fmi2OK;
}
#define NO_STATES(name)                                                                                                       \
    EXPORTED fmi2Status FMI(name)(fmi2Component c, fmi2Real x[], size_t n) {                                                  \
        (void)x;                                                                                                              \
        return n ? refuse(c, "the model has no continuous states and no event indicators") : fmi2OK;                          \
    }
NO_STATES(fmi2GetDerivatives)
NO_STATES(fmi2GetEventIndicators)
NO_STATES(fmi2GetContinuousStates)
NO_STATES(fmi2GetNominalsOfContinuousStates)

/* ---- co-simulation ---- */

EXPORTED fmi2Status FMI(fmi2SetRealInputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                     const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr; (void)order; (void)value;
    return n ? refuse(c, "inputs are not interpolated") : fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2GetRealOutputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                      const fmi2Integer order[], fmi2Real value[]) {
    (void)vr; (void)order; (void)value;
    return n ? refuse(c, "outputs have no derivatives") : fmi2OK;
}
EXPORTED fmi2Status FMI(fmi2DoStep)(fmi2Component c, fmi2Real from, fmi2Real step, fmi2Boolean no_return) {
    (void)no_return;
    ((instance *)c)->now.time = from + step;
    return compute(c);
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
