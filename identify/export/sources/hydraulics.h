/* Oil, edges and lines of a valve at one operating point (docs/physics.md sections 2, 3, 5): what the static balances and the servo
   share. No state is kept. C99, no library but math.h. */
#ifndef THERMOHYD_HYDRAULICS_H
#define THERMOHYD_HYDRAULICS_H

#include "numbers.h"

#include <math.h>

typedef thermohyd_parameters P;

#define LN10 2.302585092994046
#define PI 3.14159265358979323846
#define T_OIL 288.15 /* K, 15 degC: where the oil's coefficients are stated */
#define T_VALVE 313.15 /* K, 40 degC: where clearance, null and leaks are stated */
#define SMALLEST_CLEARANCE 1e-8

static inline double positive(double x) { return x > 0.0 ? x : 0.0; }
static inline double square(double x) { return x * x; }

/* ---- roots ---- */

typedef double (*function)(double x, void *about);

/* The root of f between a and b, where its signs differ; else the end where it is smaller (Brent, 1973, chapter 4). */
static inline double root(function f, void *about, double a, double b) {
    double fa = f(a, about), fb = f(b, about);
    if (fa == 0.0) return a;
    if (fb == 0.0) return b;
    if ((fa > 0.0) == (fb > 0.0)) return fabs(fa) < fabs(fb) ? a : b;
    double c = a, fc = fa, d = b - a, e = d;
    for (int i = 0; i < 200; i++) {
        if ((fb > 0.0) == (fc > 0.0)) { c = a; fc = fa; d = b - a; e = d; }
        if (fabs(fc) < fabs(fb)) { a = b; b = c; c = a; fa = fb; fb = fc; fc = fa; }
        double near = 4.5e-16 * fabs(b), m = 0.5 * (c - b);
        if (fabs(m) <= near || fb == 0.0) break;
        if (fabs(e) < near || fabs(fa) <= fabs(fb)) {
            d = m; e = m;
        } else {
            double s = fb / fa, p, q;
            if (a == c) { p = 2.0 * m * s; q = 1.0 - s; }
            else { double u = fa / fc, r = fb / fc; p = s * (2.0 * m * u * (u - r) - (b - a) * (r - 1.0)); q = (u - 1.0) * (r - 1.0) * (s - 1.0); }
            if (p > 0.0) q = -q; else p = -p;
            if (2.0 * p < 3.0 * m * q - fabs(near * q) && p < fabs(0.5 * e * q)) { e = d; d = p / q; }
            else { d = m; e = m; }
        }
        a = b; fa = fb;
        b += fabs(d) > near ? d : (m > 0.0 ? near : -near);
        fb = f(b, about);
    }
    return b;
}

/* ---- oil (section 2) ---- */

typedef struct { double temperature, density, modulus, viscosity; } oil;

static inline oil oil_at(const P *p, double t) {
    oil o;
    o.temperature = t;
    o.density = p->density * (1.0 - p->expansion * (t - T_OIL));
    o.modulus = p->bulk_modulus * exp(-p->bulk_modulus_decay * (t - T_OIL));
    double exponent = p->viscosity_a - p->viscosity_b * log10(t);
    o.viscosity = o.density * (expm1(LN10 * exp(LN10 * exponent)) + 0.3) * 1e-6 * (1.0 + p->viscosity_shift);
    return o;
}

static inline double squeezed(const P *p, const oil *o, double pressure) {
    double stiffening = 1.0 + p->tait_slope;
    return 1.0 - log(1.0 + stiffening * pressure / o->modulus) / stiffening;
}

static inline double density(const P *p, const oil *o, double pressure) { return o->density / squeezed(p, o, pressure); }

static inline double viscosity(const P *p, const oil *o, double pressure) {
    return o->viscosity * exp((p->oil_pressure_viscosity + p->pressure_viscosity) * pressure);
}

/* (1 - alpha T) drop/(rho c_p): how much warmer throttled oil is. */
static inline double throttling_rise(const P *p, double drop, double mean, double t) {
    oil o = oil_at(p, t);
    double d = squeezed(p, &o, mean), stiff = d * (o.modulus + (1.0 + p->tait_slope) * mean);
    double alpha = p->expansion * p->density / o.density - p->bulk_modulus_decay * mean / stiff;
    return (1.0 - alpha * t) / (o.density / d) * drop / (p->specific_heat + p->specific_heat_slope * (t - T_OIL));
}

/* ---- the film between two rounded edges (section 3.1) ---- */

static inline void moments(double sine, double cosine, double angle, double m[4]) {
    double z = sine * sine, product = sine * cosine;
    m[0] = angle;
    if (z >= 0.07) {
        m[1] = 0.5 * (angle - product);
        m[2] = 0.25 * (3.0 * m[1] - z * product);
        m[3] = (5.0 * m[2] - z * z * product) / 6.0;
        return;
    }
    double series = 0.0, coefficient[12] = {1.0};
    for (int j = 1; j < 12; j++) coefficient[j] = coefficient[j - 1] * (2.0 * j - 1.0) / (2.0 * j);
    for (int j = 11; j >= 0; j--) series = series * z + coefficient[j] / (7.0 + 2.0 * j);
    m[3] = z * z * z * sine * series;
    m[2] = (6.0 * m[3] + z * z * product) / 5.0;
    m[1] = (4.0 * m[2] + z * product) / 3.0;
}

static inline double one_arc(double reach, double ratio) {
    if (reach >= 1.0) return 0.0;
    double q = 1.0 / (1.0 + 2.0 * ratio), gamma = sqrt(q), tall = gamma * (1.0 + sqrt(1.0 - reach * reach));
    double length = sqrt(tall * tall + reach * reach), end = sqrt(1.0 + q), upper[4], lower[4];
    moments(tall / length, reach / length, atan2(tall, reach), upper);
    moments(gamma / end, 1.0 / end, atan(gamma), lower);
    double m0 = upper[0] - lower[0], m1 = upper[1] - lower[1], m2 = upper[2] - lower[2];
    return 2.0 * gamma * ((1.0 - q * q) * m2 + q * q * (2.0 * m1 - m0));
}

static inline double two_arcs(double share, double ratio) {
    double room = 1.0 - share, start = share < 0.5 ? sqrt((1.0 - 2.0 * share) / room) : 0.0, sum = 0.0;
    for (int i = 0; i < THERMOHYD_FILM_NODES; i++) {
        double z = 1.0 - (1.0 - start) * film_place[i], z2 = z * z, s = room * (1.0 - z2);
        double own = z * sqrt(room * (1.0 + (share + s))), other = sqrt(room * (2.0 - z2) * (1.0 + (share - s)));
        double thin = 1.0 / (1.0 + ratio * (2.0 - own - other));
        sum += 2.0 * film_weight[i] * z * thin * thin * thin;
    }
    return sum * (1.0 - start) * room;
}

static inline double film_resistance(double opening, double radius, double clearance) {
    double ends = 2.0 * radius > 1e-30 ? 2.0 * radius : 0.0, arcs = 0.0;
    if (opening < ends) {
        double share = opening > 0.0 ? fmin(opening / ends, 1.0 - 2.220446049250313e-16) : 0.0, ratio = radius / clearance;
        arcs = one_arc(fmin(2.0 * share, 1.0), ratio) + two_arcs(share, ratio);
    }
    return (positive(-opening) + 2.0 * radius * arcs) / (clearance * clearance * clearance);
}

/* ---- one metering edge (section 3) ---- */

typedef struct { double opening, radius, clearance; } edge;

static inline double tanhc(double y) {
    if (y < 0.02)
        return 1.0 + y * (-1.0 / 3 + y * (2.0 / 15 + y * (-17.0 / 315 + y * (62.0 / 2835 + y * (-1382.0 / 155925
            + y * (21844.0 / 6081075 + y * (-929569.0 / 638512875)))))));
    double s = sqrt(y);
    return tanh(s) / s;
}

/* kg/s along a positive drop; o: the oil upstream, mean: of both pressures; leaking: over the lands between the slots. */
static inline double edge_flow(const P *p, const edge *e, const oil *o, double drop, double mean, double leaking) {
    double rho = density(p, o, mean), mu = viscosity(p, o, mean), w = p->slot_width;
    double c = e->clearance + p->pressure_clearance * mean, c3 = c * c * c, flow;
    double h2 = square(sqrt(square(positive(e->opening)) + square(c + 2.0 * e->radius)) - 2.0 * e->radius);
    double land_factor = 1.0 + 1.5 * square(p->eccentricity), parallel = leaking * c3 / 12.0;
    if (p->edge_law == 0.0) {
        double number = p->transition_number, y = 32.0 * h2 / square(number) * rho * fabs(drop) / square(mu);
        double orifice = 8.0 * p->discharge_coefficient * w * h2 / number * tanhc(y);
        double land = 12.0 * positive(-e->opening) / (w * c3) / land_factor;
        flow = (orifice / (1.0 + orifice * land) + parallel) * drop / mu;
    } else {
        double slit = 8.0 / (3.0 * PI) / h2, film = film_resistance(e->opening, e->radius, c) / land_factor;
        double laminar = mu * 12.0 * slit * sqrt(sqrt(1.0 + square(square(film / slit)))) / w;
        double inertia = 2.0 / (square(p->discharge_coefficient * w) * h2);
        flow = 2.0 * drop / (laminar + sqrt(square(laminar) + rho * inertia * fabs(drop))) + parallel * drop / mu;
    }
    return rho * flow;
}

static inline double mass_flow(const P *p, const edge *e, const oil *o, double drop, double mean) {
    return edge_flow(p, e, o, drop, mean, p->land_leakage);
}

/* ---- the valve at one operating point ---- */

static inline double thinning(const P *p, double t) {
    oil warm = oil_at(p, T_VALVE), own = oil_at(p, t);
    return warm.viscosity / own.viscosity;
}

/* Where the hydraulic null lies. */
static inline double null_of(const P *p, double supply, double temperature) {
    double shift = p->null_shift_temperature * (temperature - T_VALVE);
    return p->null_bias + shift + p->null_shift_pressure * (supply - p->null_pressure);
}

typedef struct {
    const P *p;
    edge supply[2], back[2]; /* P-A, P-B and A-T, B-T */
    oil fresh;
    double temperature, gauge_supply, gauge_return; /* as the inputs say */
    double ps, pt;                                  /* behind the lines */
    double crossing;                                /* m3/(s Pa) between the ports */
    /* of static balances alone */
    double eta;  /* share of the throttling heat that stays in the oil */
    double load; /* p_A - p_B of a load flow */
    double q[2]; /* logits of the port pressures */
} valve;

/* The edges at an opening x from the middle of the spool's stroke, and the oil at these pressures and this temperature. */
static inline void open_edges(valve *v, const P *p, double position, double supply, double back, double temperature) {
    double warmer = temperature - T_VALVE, clearance = p->clearance;
    if (p->thermal_clearance != 0.0) clearance = fmax(clearance + p->thermal_clearance * warmer, SMALLEST_CLEARANCE);
    double x = position - null_of(p, supply, temperature);
    double rs = p->edge_radius + p->supply_edge_wear, rt = p->edge_radius + p->return_edge_wear;
    double us = p->underlap, ut = p->underlap + p->unequal_underlap;
    v->p = p;
    v->supply[0] = (edge){us + x, rs + p->edge_wear_pa, clearance};
    v->supply[1] = (edge){us - x, rs + p->edge_wear_pb, clearance};
    v->back[0] = (edge){ut - x, rt + p->edge_wear_at, clearance};
    v->back[1] = (edge){ut + x, rt + p->edge_wear_bt, clearance};
    v->temperature = temperature;
    v->fresh = oil_at(p, temperature);
    v->gauge_supply = v->ps = supply;
    v->gauge_return = v->pt = back;
    v->crossing = p->cross_port_leakage != 0.0 ? p->cross_port_leakage * thinning(p, temperature) : 0.0;
}

/* m3/s that pass beside the spool, from the supply to the return. */
static inline double beside_the_spool(const valve *v) {
    double drop = v->gauge_supply - v->gauge_return;
    return v->p->pilot_leakage * sqrt(positive(drop)) + v->p->bushing_leakage * drop * thinning(v->p, v->temperature);
}

static inline int has_lines(const P *p) { return p->flow_saturation != 0.0 || p->supply_droop != 0.0 || p->return_back_pressure != 0.0; }

/* The pressures at the edges where these volumes pass the gauges. */
static inline void lose(valve *v, double supplied, double returned) {
    const P *p = v->p;
    v->ps = v->gauge_supply - p->flow_saturation * supplied * fabs(supplied) - p->supply_droop * supplied;
    v->pt = v->gauge_return + (p->flow_saturation + p->return_back_pressure) * returned * fabs(returned);
}

#endif
