/* The model's numbers, each under the name that model.json gives it; the list is in parameters.h. */
#ifndef THERMOHYD_NUMBERS_H
#define THERMOHYD_NUMBERS_H

#include "parameters.h"

typedef struct {
#define THERMOHYD_FIELD(name, value) double name;
    THERMOHYD_PARAMETERS(THERMOHYD_FIELD)
#undef THERMOHYD_FIELD
} thermohyd_parameters;

/* What a computation ends with. */
enum {
    THERMOHYD_OK,
    THERMOHYD_BAD_INPUT,      /* an input that is no number, or no temperature: no output is set */
    THERMOHYD_NO_SUPPLY,      /* the return lies above the supply */
    THERMOHYD_NO_EQUILIBRIUM, /* of a servo, under its first inputs */
    THERMOHYD_TOO_MANY_STEPS,
    THERMOHYD_NOT_FINITE,
    THERMOHYD_CAVITATES
};

#endif
