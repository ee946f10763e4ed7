/* A servovalve with its actuator in motion (docs/physics.md section 9), SI units, pressures gauge. C99, no library but math.h. */
#ifndef THERMOHYD_SERVO_H
#define THERMOHYD_SERVO_H

#include "numbers.h"

enum { THERMOHYD_SETPOINT, THERMOHYD_CURRENT, THERMOHYD_SPOOL_POSITION }; /* THERMOHYD_COMMAND, of parameters.h */

typedef struct {
    double command;         /* setpoint of the piston, m; current, A; or position of the spool, m */
    double supply_pressure; /* Pa */
    double return_pressure; /* Pa */
    double temperature;     /* K, of the oil supplied */
    double external_force;  /* N, against the piston's positive direction */
} thermohyd_inputs;

/* The states in their order; the last three where the model has them. */
enum {
    SPOOL, SPOOL_SPEED, PISTON, VELOCITY, PRESSURE_A, PRESSURE_B,
    TEMPERATURE_A, TEMPERATURE_B, /* where THERMOHYD_KEEPS_HEAT */
    PLAY = 6 + 2 * THERMOHYD_KEEPS_HEAT,
    THERMOHYD_STATES = PLAY + THERMOHYD_PLAY
};

typedef struct {
    double state[THERMOHYD_STATES];
    double supply_flow; /* m3/s, at supply conditions */
    double return_flow; /* m3/s, at return conditions */
} thermohyd_outputs;

/* What is large for this plant: the states' sizes, and what they are counted from. */
typedef struct { double origin[THERMOHYD_STATES], size[THERMOHYD_STATES]; } thermohyd_scale;

/* What one state under one set of inputs leads to. */
typedef struct {
    double target;                               /* m, where the spool is driven to */
    double thrust;                               /* N, on the moving mass */
    double jets;                                 /* N, flow force on the spool per its coefficient */
    double squeeze[2], heating[2], renewal[2];   /* 1/s, K/s, 1/s: what changes pressures and temperatures */
    double supplied, returned;                   /* m3/s */
    double rate[THERMOHYD_STATES];
} thermohyd_instant;

void thermohyd_instant_at(const thermohyd_parameters *, const thermohyd_inputs *, const double state[], thermohyd_instant *);
/* The spool position that the controller or the command asks for, within the stroke; where the hydraulic null lies. */
double thermohyd_asked(const thermohyd_parameters *, double command, double piston);
double thermohyd_null(const thermohyd_parameters *, const thermohyd_inputs *);
/* m of spool command per m of position error. */
double thermohyd_loop_gain(const thermohyd_parameters *);
void thermohyd_scaling(const thermohyd_parameters *, const thermohyd_inputs *, thermohyd_scale *);
/* The steady state under these inputs (equilibrium.c). */
int thermohyd_equilibrium(const thermohyd_parameters *, const thermohyd_inputs *, double state[]);
/* From `begin` on over `span` seconds, inputs linear in time; pace: length of the next step, kept between calls (rodas5p.c). */
int thermohyd_integrate(const thermohyd_parameters *, const thermohyd_inputs *, const thermohyd_inputs *slope,
                        const thermohyd_scale *, double span, double tolerance, double *pace, double state[]);
/* x of matrix x = right, in the place of right; both are overwritten (rodas5p.c). 0 where the matrix is singular. */
int thermohyd_solve(int n, double matrix[][THERMOHYD_STATES], double right[]);

#endif
