/* Rodas5P with steps by its embedded error: Steinebach, BIT Numerical Mathematics 63, 27 (2023), in the form of Hairer and Wanner
   (Solving ODEs II, section IV.7), as the library integrates; the Jacobian by central differences of the scaled state. */
#include "servo.h"
#include "tableau.h"

#include <math.h>
#include <string.h>

#define N THERMOHYD_STATES
#define STAGES 8
#define DIFFERENCE 3e-7
#define MOST_STEPS 100000
#define VACUUM -101325.0 /* Pa, gauge */

typedef struct {
    const thermohyd_parameters *p;
    const thermohyd_inputs *from, *slope;
    const thermohyd_scale *scale;
} run;

static void field(const run *r, double time, const double y[N], double rate[N]) {
    const double *from = (const double *)r->from, *slope = (const double *)r->slope;
    thermohyd_inputs in;
    double *now = (double *)&in, state[N];
    for (size_t i = 0; i < sizeof in / sizeof *now; i++) now[i] = from[i] + time * slope[i];
    for (int i = 0; i < N; i++) state[i] = r->scale->origin[i] + y[i] * r->scale->size[i];
    thermohyd_instant at;
    thermohyd_instant_at(r->p, &in, state, &at);
    for (int i = 0; i < N; i++) rate[i] = at.rate[i] / r->scale->size[i];
}

/* matrix = L U in place, rows exchanged as `order` says; 0 where it is singular. */
static int factorised(int n, double matrix[][N], int order[]) {
    for (int k = 0; k < n; k++) {
        int best = k;
        for (int i = k + 1; i < n; i++) if (fabs(matrix[i][k]) > fabs(matrix[best][k])) best = i;
        if (!(fabs(matrix[best][k]) > 0.0) || !isfinite(matrix[best][k])) return 0;
        order[k] = best;
        for (int j = 0; best != k && j < n; j++) { double held = matrix[k][j]; matrix[k][j] = matrix[best][j]; matrix[best][j] = held; }
        for (int i = k + 1; i < n; i++) {
            double factor = matrix[i][k] /= matrix[k][k];
            for (int j = k + 1; j < n; j++) matrix[i][j] -= factor * matrix[k][j];
        }
    }
    return 1;
}

static void substitute(int n, double matrix[][N], const int order[], double right[]) {
    for (int k = 0; k < n; k++) { double held = right[order[k]]; right[order[k]] = right[k]; right[k] = held; }
    for (int i = 0; i < n; i++) for (int j = 0; j < i; j++) right[i] -= matrix[i][j] * right[j];
    for (int i = n - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++) right[i] -= matrix[i][j] * right[j];
        right[i] /= matrix[i][i];
    }
}

int thermohyd_solve(int n, double matrix[][N], double right[]) {
    int order[N];
    if (!factorised(n, matrix, order)) return 0;
    substitute(n, matrix, order, right);
    return 1;
}

static void slopes(const run *r, double time, double span, const double y[N], double jacobian[N][N], double in_time[N]) {
    double moved[N], up[N], down[N];
    memcpy(moved, y, sizeof moved);
    for (int j = 0; j < N; j++) {
        moved[j] = y[j] + DIFFERENCE;
        field(r, time, moved, up);
        moved[j] = y[j] - DIFFERENCE;
        field(r, time, moved, down);
        moved[j] = y[j];
        for (int i = 0; i < N; i++) jacobian[i][j] = (up[i] - down[i]) / (2.0 * DIFFERENCE);
    }
    memset(in_time, 0, N * sizeof *in_time);
    const double *slope = (const double *)r->slope;
    for (size_t i = 0; i < sizeof *r->slope / sizeof *slope; i++) {
        if (slope[i] == 0.0) continue;
        field(r, time + 1e-3 * span, y, up);
        field(r, time - 1e-3 * span, y, down);
        for (int k = 0; k < N; k++) in_time[k] = (up[k] - down[k]) / (2e-3 * span);
        return;
    }
}

/* One step of length h: the new y, and the norm of its error in units of the tolerance; infinite where the step makes no sense. */
static double step(const run *r, double time, double h, const double y0[N], double jacobian[N][N], const double in_time[N],
                   double tolerance, double y1[N]) {
    double matrix[N][N], k[STAGES][N], y[N], sum = 0.0;
    int order[N];
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) matrix[i][j] = (i == j ? 1.0 / (tableau_gamma * h) : 0.0) - jacobian[i][j];
    if (!factorised(N, matrix, order)) return INFINITY;
    for (int s = 0; s < STAGES; s++) {
        double right[N];
        for (int i = 0; i < N; i++) {
            y[i] = y0[i];
            for (int q = 0; q < s; q++) y[i] += tableau_a[s][q] * k[q][i];
        }
        field(r, time + tableau_nodes[s] * h, y, right);
        for (int i = 0; i < N; i++) {
            right[i] += h * tableau_d[s] * in_time[i];
            for (int q = 0; q < s; q++) right[i] += tableau_c[s][q] * k[q][i] / h;
        }
        substitute(N, matrix, order, right);
        memcpy(k[s], right, sizeof right);
    }
    for (int i = 0; i < N; i++) {
        y1[i] = y[i] + k[STAGES - 1][i];
        double error = k[STAGES - 1][i] / (tolerance * (1.0 + fmax(fabs(y0[i]), fabs(y1[i]))));
        if (!isfinite(error)) return INFINITY;
        sum += error * error;
    }
    return sqrt(sum / N);
}

int thermohyd_integrate(const thermohyd_parameters *p, const thermohyd_inputs *from, const thermohyd_inputs *slope,
                        const thermohyd_scale *scale, double span, double tolerance, double *pace, double state[]) {
    const run r = {p, from, slope, scale};
    double time = 0.0, y[N], y1[N], jacobian[N][N], in_time[N];
    int known = 0, refused = 0; /* the Jacobian is that of y; the last step was refused */
    for (int i = 0; i < N; i++) y[i] = (state[i] - scale->origin[i]) / scale->size[i];
    for (int taken = 0; time < span; taken++) {
        if (taken == MOST_STEPS) return THERMOHYD_TOO_MANY_STEPS;
        double left = span - time, h = *pace < left ? (2.0 * *pace > left ? 0.5 * left : *pace) : left;
        if (!known) slopes(&r, time, h, y, jacobian, in_time);
        known = 1;
        double error = step(&r, time, h, y, jacobian, in_time, tolerance, y1);
        double factor = error > 0.0 ? 0.9 * pow(error, -0.2) : 5.0;
        factor = factor < 0.2 ? 0.2 : factor > 5.0 ? 5.0 : factor;
        if (!(error <= 1.0)) {
            *pace = h * factor;
            if (!(*pace > 1e-12)) return THERMOHYD_NOT_FINITE;
            refused = 1;
            continue;
        }
        if (refused && factor > 1.0) factor = 1.0;
        refused = 0;
        known = 0;
        time = h < left ? time + h : span;
        /* A step that the end cut short says little of the pace beyond. */
        if (h >= *pace || h * factor > *pace) *pace = h * factor;
        memcpy(y, y1, sizeof y);
    }
    for (int i = 0; i < N; i++) {
        state[i] = scale->origin[i] + y[i] * scale->size[i];
        if (!isfinite(state[i])) return THERMOHYD_NOT_FINITE;
    }
    return state[PRESSURE_A] < VACUUM || state[PRESSURE_B] < VACUUM ? THERMOHYD_CAVITATES : THERMOHYD_OK;
}
