/* Where a run starts: the steady state under the first inputs (docs/physics.md section 9.5), by damped Newton with differences.

   Closed loop: everything at rest, the spool where the closed ports carry the external force, the piston where the loop asks for
   that spool. Open loop: the spool where the command puts it, the piston at mid stroke and at its steady speed. */
#include "servo.h"

#include <math.h>

#define MOST_TURNS 200
#define KELVINS 10.0
#define UNRENEWED 1e-18
#define BALANCED 1e-11
#define ROUNDING 1e-15
#define SHORTEST 1e-3 /* of a Newton step */
#define DIFFERENCE 1e-7

typedef thermohyd_parameters P;
enum { CLOSED = THERMOHYD_COMMAND == THERMOHYD_SETPOINT };

typedef struct {
    const P *p;
    const thermohyd_inputs *in;
    thermohyd_scale scale;
    double base[THERMOHYD_STATES];
    int unknown[THERMOHYD_STATES], count;
} search;

static void state_of(const search *s, const double x[], double state[]) {
    for (int i = 0; i < THERMOHYD_STATES; i++) state[i] = s->base[i];
    for (int i = 0; i < s->count; i++) state[s->unknown[i]] = s->scale.origin[s->unknown[i]] + s->scale.size[s->unknown[i]] * x[i];
}

static double imbalance(const search *s, const double x[], double row[]) {
    const P *p = s->p;
    double state[THERMOHYD_STATES], norm = 0.0, area = 0.5 * (p->piston_area_a + p->piston_area_b);
    thermohyd_instant now;
    state_of(s, x, state);
    thermohyd_instant_at(p, s->in, state, &now);
    int n = 0;
    row[n++] = now.thrust / (area * (s->in->supply_pressure - s->in->return_pressure));
    if (!CLOSED) row[n++] = (now.target - state[SPOOL]) / p->stroke;
    for (int i = 0; i < 2; i++) {
        double turnover = 0.1 * s->scale.size[VELOCITY] * (i ? p->piston_area_b / p->chamber_volume_b : p->piston_area_a / p->chamber_volume_a);
        /* Not the rate of a temperature, but how far it is from where its inflow takes it: nearly linear in everything. */
        if (THERMOHYD_KEEPS_HEAT) {
            double kept = UNRENEWED * (s->in->temperature - state[TEMPERATURE_A + i]);
            row[n++] = (now.heating[i] + kept) / (now.renewal[i] + UNRENEWED) / KELVINS;
        }
        row[n++] = now.squeeze[i] / turnover;
    }
    for (int i = 0; i < n; i++) norm = isfinite(row[i]) ? fmax(norm, fabs(row[i])) : INFINITY;
    return norm;
}

static double find(const search *s, double best[]) {
    double move[THERMOHYD_STATES] = {0.0}, size = INFINITY, length = 1.0;
    for (int turn = 0; turn < MOST_TURNS && size > ROUNDING; turn++) {
        int n = s->count, stuck = length < SHORTEST && size >= BALANCED;
        double tried[THERMOHYD_STATES], row[THERMOHYD_STATES], jacobian[THERMOHYD_STATES][THERMOHYD_STATES];
        for (int i = 0; i < n; i++) tried[i] = best[i] - (stuck ? 1.0 : length) * move[i];
        double norm = imbalance(s, tried, row);
        if (!(norm < size) && !(stuck && isfinite(norm))) {
            if (size < BALANCED) break;
            length *= 0.4;
            continue;
        }
        for (int i = 0; i < n; i++) best[i] = tried[i];
        size = norm;
        length = 1.0;
        for (int j = 0; j < n; j++) {
            double up[THERMOHYD_STATES], down[THERMOHYD_STATES], at = tried[j];
            tried[j] = at + DIFFERENCE;
            imbalance(s, tried, up);
            tried[j] = at - DIFFERENCE;
            imbalance(s, tried, down);
            tried[j] = at;
            for (int i = 0; i < n; i++) jacobian[i][j] = (up[i] - down[i]) / (2.0 * DIFFERENCE);
        }
        if (!thermohyd_solve(n, jacobian, row)) return INFINITY;
        for (int i = 0; i < n; i++) move[i] = row[i];
    }
    return size;
}

int thermohyd_equilibrium(const P *p, const thermohyd_inputs *in, double state[]) {
    search s = {.p = p, .in = in};
    double span = in->supply_pressure - in->return_pressure, middle = 0.5 * (in->supply_pressure + in->return_pressure);
    if (!(span > 0.0)) return THERMOHYD_NO_SUPPLY;
    thermohyd_scaling(p, in, &s.scale);
    for (int i = 0; i < THERMOHYD_STATES; i++) s.base[i] = s.scale.origin[i];
    double half = 0.5 * (in->external_force - (p->piston_area_a - p->piston_area_b) * middle) / (0.5 * (p->piston_area_a + p->piston_area_b));
    half = fmax(fmin(half, 0.49 * span), -0.49 * span);
    s.base[PRESSURE_A] = middle + half;
    s.base[PRESSURE_B] = middle - half;
    double asked = thermohyd_asked(p, in->command, 0.0);
    if (THERMOHYD_PLAY) s.base[PLAY] = asked;
    s.base[SPOOL] = CLOSED ? thermohyd_null(p, in) : asked;
    if (!CLOSED) s.unknown[s.count++] = VELOCITY;
    s.unknown[s.count++] = SPOOL;
    for (int i = PRESSURE_A; i < PLAY; i++) s.unknown[s.count++] = i;
    double x[THERMOHYD_STATES];
    for (int i = 0; i < s.count; i++) x[i] = (s.base[s.unknown[i]] - s.scale.origin[s.unknown[i]]) / s.scale.size[s.unknown[i]];
    if (!(find(&s, x) < BALANCED)) return THERMOHYD_NO_EQUILIBRIUM;
    state_of(&s, x, state);
    if (!CLOSED) return THERMOHYD_OK;
    thermohyd_instant now;
    thermohyd_instant_at(p, in, state, &now);
    asked = state[SPOOL] + p->flow_force * now.jets;
    state[PISTON] = in->command - asked / thermohyd_loop_gain(p);
    if (THERMOHYD_PLAY) state[PLAY] = asked;
    return fabs(asked) <= p->stroke ? THERMOHYD_OK : THERMOHYD_NO_EQUILIBRIUM;
}
