/* A servovalve's static flows (docs/physics.md sections 2 to 5), SI units, pressures gauge. C99, no library but math.h. */
#ifndef THERMOHYD_VALVE_H
#define THERMOHYD_VALVE_H

#include "numbers.h"

typedef struct {
    double spool_position;  /* m; of a valve that is driven by a current: A */
    double spool_direction; /* +1, -1: the way that the spool last moved; 0: the middle of its hysteresis */
    double supply_pressure; /* Pa */
    double return_pressure; /* Pa */
    double temperature;     /* K, of the oil supplied */
    double pressure_a;      /* Pa */
    double pressure_b;      /* Pa */
} thermohyd_inputs;

typedef struct {
    /* with the port pressures imposed: volume flows, m3/s */
    double flow_a;      /* out of port A into the load, at the port's pressure and temperature */
    double flow_b;      /* out of the load into port B, likewise */
    double supply_flow; /* at supply conditions */
    double return_flow; /* at return conditions */
    double mass_flow_a; /* kg/s */
    double mass_flow_b; /* kg/s */
    /* the load flow: pressure_a - pressure_b imposed, their mean as the edges balance it; m3/s */
    double load_flow;
    /* with both ports closed */
    double blocked_pressure_a; /* Pa */
    double blocked_pressure_b; /* Pa */
    double leakage_flow;       /* m3/s, in the return */
} thermohyd_outputs;

/* All outputs. THERMOHYD_NO_SUPPLY: what asks for a balance of the ports is then NaN. */
int thermohyd_valve(const thermohyd_parameters *parameters, const thermohyd_inputs *inputs, thermohyd_outputs *outputs);

#endif
