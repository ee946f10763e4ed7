/* What an FMU of any version asks of the physics: values by their references, states, time. One of valve.h and servo.h is behind it.

   References: parameters from 0, inputs from 1000, outputs from 2000, rates of the states from 3000, each in the order of its struct;
   the first outputs of a servo are its states. */
#ifndef THERMOHYD_MODEL_H
#define THERMOHYD_MODEL_H

#include "numbers.h"

#if THERMOHYD_SERVO
#include "servo.h"
#else
#include "valve.h"
enum { THERMOHYD_STATES = 0 };
typedef struct { double size[1]; } thermohyd_scale;
#endif

#define THERMOHYD_PARAMETER_COUNT (sizeof(thermohyd_parameters) / sizeof(double))
#define THERMOHYD_INPUT_COUNT (sizeof(thermohyd_inputs) / sizeof(double))
#define THERMOHYD_OUTPUT_COUNT (sizeof(thermohyd_outputs) / sizeof(double))
enum { FIRST_INPUT = 1000, FIRST_OUTPUT = 2000, FIRST_RATE = 3000 };

/* Everything that may be saved and restored, and nothing of the host's. */
typedef struct {
    thermohyd_parameters parameters;
    thermohyd_inputs inputs, slope; /* slope: of the inputs over the next step, per second */
    thermohyd_outputs outputs;
    thermohyd_scale scale;
    double state[THERMOHYD_STATES + 1], rate[THERMOHYD_STATES + 1];
    double time, tolerance, pace;
    int stale;   /* outputs are those of other inputs or states */
    int settled; /* initialisation is over: parameters are fixed, states move by themselves */
    int code;    /* with which the outputs were computed */
} thermohyd_model;

void thermohyd_start(thermohyd_model *);
int thermohyd_compute(thermohyd_model *);
/* The end of initialisation. */
int thermohyd_settle(thermohyd_model *);
/* Co-simulation: on to a time. */
int thermohyd_advance(thermohyd_model *, double to);
/* 0 where no variable has this reference, -1 where it cannot be had or set now. */
int thermohyd_get(thermohyd_model *, unsigned reference, double *value);
int thermohyd_set(thermohyd_model *, unsigned reference, double value);
/* Of the inputs alone, over the next step. */
int thermohyd_set_slope(thermohyd_model *, unsigned reference, double value);
void thermohyd_set_states(thermohyd_model *, const double state[]);
const char *thermohyd_words(int code);

#endif
