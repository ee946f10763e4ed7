/* The physics as an FMU's interface sees it (model.h). */
#include "model.h"

#include <math.h>
#include <string.h>

#define TOLERANCE 3e-9
#define TWO_PI 6.28318530717958647692

static void defaults(thermohyd_parameters *p) {
#define THERMOHYD_DEFAULT(name, value) p->name = value;
    THERMOHYD_PARAMETERS(THERMOHYD_DEFAULT)
#undef THERMOHYD_DEFAULT
}

void thermohyd_start(thermohyd_model *m) {
    const thermohyd_inputs inputs = {THERMOHYD_START_INPUTS};
    memset(m, 0, sizeof *m);
    defaults(&m->parameters);
    m->inputs = inputs;
    m->tolerance = TOLERANCE;
    m->stale = 1;
}

#if THERMOHYD_SERVO
static int sound(const thermohyd_inputs *in) {
    const double *all = (const double *)in;
    for (size_t i = 0; i < THERMOHYD_INPUT_COUNT; i++) if (!isfinite(all[i])) return 0;
    return in->temperature > 150.0 && in->temperature < 700.0;
}

static int begin(thermohyd_model *m) {
    int code = sound(&m->inputs) ? thermohyd_equilibrium(&m->parameters, &m->inputs, m->state) : THERMOHYD_BAD_INPUT;
    if (code == THERMOHYD_OK) thermohyd_scaling(&m->parameters, &m->inputs, &m->scale);
    m->pace = 0.1 / (TWO_PI * m->parameters.spool_frequency);
    return code;
}

static int evaluate(thermohyd_model *m) {
    if (!m->settled) { /* states follow the first inputs */
        int code = begin(m);
        if (code != THERMOHYD_OK) return code;
    }
    if (!sound(&m->inputs)) return THERMOHYD_BAD_INPUT;
    thermohyd_instant now;
    thermohyd_instant_at(&m->parameters, &m->inputs, m->state, &now);
    for (int i = 0; i < THERMOHYD_STATES; i++) {
        if (!isfinite(now.rate[i])) return THERMOHYD_NOT_FINITE;
        m->outputs.state[i] = m->state[i];
        m->rate[i] = now.rate[i];
    }
    m->outputs.supply_flow = now.supplied;
    m->outputs.return_flow = now.returned;
    return THERMOHYD_OK;
}

static int move(thermohyd_model *m, double span) {
    double *in = (double *)&m->inputs, *slope = (double *)&m->slope;
    if (!sound(&m->inputs)) return THERMOHYD_BAD_INPUT;
    int code = thermohyd_integrate(&m->parameters, &m->inputs, &m->slope, &m->scale, span, m->tolerance, &m->pace, m->state);
    for (size_t i = 0; i < THERMOHYD_INPUT_COUNT; i++) in[i] += span * slope[i];
    return code;
}
#else
static int evaluate(thermohyd_model *m) { return thermohyd_valve(&m->parameters, &m->inputs, &m->outputs); }
static int move(thermohyd_model *m, double span) { (void)m; (void)span; return THERMOHYD_OK; }
#endif

int thermohyd_compute(thermohyd_model *m) {
    if (!m->stale) return m->code;
    m->code = evaluate(m);
    m->stale = m->code != THERMOHYD_OK && m->code != THERMOHYD_NO_SUPPLY;
    return m->code;
}

int thermohyd_settle(thermohyd_model *m) {
    int code = THERMOHYD_STATES ? thermohyd_compute(m) : THERMOHYD_OK;
    m->settled = code == THERMOHYD_OK;
    return code;
}

int thermohyd_advance(thermohyd_model *m, double to) {
    if (THERMOHYD_STATES && to > m->time) {
        int code = move(m, to - m->time);
        m->stale = 1;
        if (code != THERMOHYD_OK) return code;
    }
    memset(&m->slope, 0, sizeof m->slope);
    m->time = to;
    return thermohyd_compute(m);
}

int thermohyd_get(thermohyd_model *m, unsigned r, double *value) {
    if (r < THERMOHYD_PARAMETER_COUNT) *value = ((const double *)&m->parameters)[r];
    else if (r >= FIRST_INPUT && r < FIRST_INPUT + THERMOHYD_INPUT_COUNT) *value = ((const double *)&m->inputs)[r - FIRST_INPUT];
    else {
        int output = r >= FIRST_OUTPUT && r < FIRST_OUTPUT + THERMOHYD_OUTPUT_COUNT;
        if (!output && !(r >= FIRST_RATE && r < FIRST_RATE + (unsigned)THERMOHYD_STATES)) return 0;
        int code = thermohyd_compute(m);
        if (code != THERMOHYD_OK && code != THERMOHYD_NO_SUPPLY) return -1;
        *value = output ? ((const double *)&m->outputs)[r - FIRST_OUTPUT] : m->rate[r - FIRST_RATE];
    }
    return 1;
}

int thermohyd_set(thermohyd_model *m, unsigned r, double value) {
    double *place;
    if (r < THERMOHYD_PARAMETER_COUNT) {
        if (m->settled) return -1;
        place = (double *)&m->parameters + r;
    } else if (r >= FIRST_INPUT && r < FIRST_INPUT + THERMOHYD_INPUT_COUNT) place = (double *)&m->inputs + (r - FIRST_INPUT);
    else return 0;
    if (*place != value) m->stale = 1;
    *place = value;
    return 1;
}

int thermohyd_set_slope(thermohyd_model *m, unsigned r, double value) {
    if (!(r >= FIRST_INPUT && r < FIRST_INPUT + THERMOHYD_INPUT_COUNT)) return 0;
    ((double *)&m->slope)[r - FIRST_INPUT] = value;
    return 1;
}

void thermohyd_set_states(thermohyd_model *m, const double state[]) {
    memcpy(m->state, state, THERMOHYD_STATES * sizeof *state);
    m->stale = 1;
}

const char *thermohyd_words(int code) {
    switch (code) {
    case THERMOHYD_BAD_INPUT: return "an input is no finite number, or the temperature is not between 150 and 700 K";
    case THERMOHYD_NO_SUPPLY: return THERMOHYD_STATES ? "the supply pressure must exceed the return pressure where a run begins"
        : "the return pressure lies above the supply pressure: blocked ports and load flow are NaN";
    case THERMOHYD_NO_EQUILIBRIUM: return "no equilibrium under the first inputs: the external force exceeds what the supply pressure "
        "can hold, or the spool that it needs lies beyond the stroke";
    case THERMOHYD_TOO_MANY_STEPS: return "the integration took too many steps: the motion is faster than any actuator's";
    case THERMOHYD_NOT_FINITE: return "the integration failed: the states are no longer finite";
    case THERMOHYD_CAVITATES: return "the pressure in a chamber falls below absolute vacuum: the oil would cavitate there, which the "
        "model does not have";
    }
    return "";
}
