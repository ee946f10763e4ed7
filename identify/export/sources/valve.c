/* A servovalve's static flows: oil, edge laws, port balances and effects (docs/physics.md sections 2 to 5, 8).

   One port balance is one falling function of the logit of a pressure's share between return and supply, and its root is found by
   Brent's method to rounding. Lines and a path between the ports nest such roots. Nothing is kept between calls. */
#include "valve.h"

#include <math.h>

typedef thermohyd_parameters P;

#define LN10 2.302585092994046
#define PI 3.14159265358979323846
#define T_OIL 288.15 /* K, 15 degC: where the oil's coefficients are stated */
#define T_VALVE 313.15 /* K, 40 degC: where clearance, null and leaks are stated */
#define SMALLEST_CLEARANCE 1e-8
#define BRACKET 40.0

void thermohyd_defaults(P *p) {
#define THERMOHYD_DEFAULT(name, value) p->name = value;
    THERMOHYD_PARAMETERS(THERMOHYD_DEFAULT)
#undef THERMOHYD_DEFAULT
}

static double positive(double x) { return x > 0.0 ? x : 0.0; }
static double square(double x) { return x * x; }

/* ---- roots ---- */

typedef double (*function)(double x, void *about);

/* The root of f between a and b, where its signs differ; else the end where it is smaller (Brent, 1973, chapter 4). */
static double root(function f, void *about, double a, double b) {
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

static oil oil_at(const P *p, double t) {
    oil o;
    o.temperature = t;
    o.density = p->density * (1.0 - p->expansion * (t - T_OIL));
    o.modulus = p->bulk_modulus * exp(-p->bulk_modulus_decay * (t - T_OIL));
    double exponent = p->viscosity_a - p->viscosity_b * log10(t);
    o.viscosity = o.density * (expm1(LN10 * exp(LN10 * exponent)) + 0.3) * 1e-6 * (1.0 + p->viscosity_shift);
    return o;
}

static double squeezed(const P *p, const oil *o, double pressure) {
    double stiffening = 1.0 + p->tait_slope;
    return 1.0 - log(1.0 + stiffening * pressure / o->modulus) / stiffening;
}

static double density(const P *p, const oil *o, double pressure) { return o->density / squeezed(p, o, pressure); }

static double viscosity(const P *p, const oil *o, double pressure) {
    return o->viscosity * exp((p->oil_pressure_viscosity + p->pressure_viscosity) * pressure);
}

/* (1 - alpha T) drop/(rho c_p): how much warmer throttled oil is. */
static double throttling_rise(const P *p, double drop, double mean, double t) {
    oil o = oil_at(p, t);
    double d = squeezed(p, &o, mean), stiff = d * (o.modulus + (1.0 + p->tait_slope) * mean);
    double alpha = p->expansion * p->density / o.density - p->bulk_modulus_decay * mean / stiff;
    return (1.0 - alpha * t) / (o.density / d) * drop / (p->specific_heat + p->specific_heat_slope * (t - T_OIL));
}

/* ---- the film between two rounded edges (section 3.1) ---- */

static void moments(double sine, double cosine, double angle, double m[4]) {
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

static double one_arc(double reach, double ratio) {
    if (reach >= 1.0) return 0.0;
    double q = 1.0 / (1.0 + 2.0 * ratio), gamma = sqrt(q), tall = gamma * (1.0 + sqrt(1.0 - reach * reach));
    double length = sqrt(tall * tall + reach * reach), end = sqrt(1.0 + q), upper[4], lower[4];
    moments(tall / length, reach / length, atan2(tall, reach), upper);
    moments(gamma / end, 1.0 / end, atan(gamma), lower);
    double m0 = upper[0] - lower[0], m1 = upper[1] - lower[1], m2 = upper[2] - lower[2];
    return 2.0 * gamma * ((1.0 - q * q) * m2 + q * q * (2.0 * m1 - m0));
}

static double two_arcs(double share, double ratio) {
    double room = 1.0 - share, start = share < 0.5 ? sqrt((1.0 - 2.0 * share) / room) : 0.0, sum = 0.0;
    for (int i = 0; i < THERMOHYD_FILM_NODES; i++) {
        double z = 1.0 - (1.0 - start) * film_place[i], z2 = z * z, s = room * (1.0 - z2);
        double own = z * sqrt(room * (1.0 + (share + s))), other = sqrt(room * (2.0 - z2) * (1.0 + (share - s)));
        double thin = 1.0 / (1.0 + ratio * (2.0 - own - other));
        sum += 2.0 * film_weight[i] * z * thin * thin * thin;
    }
    return sum * (1.0 - start) * room;
}

static double film_resistance(double opening, double radius, double clearance) {
    double ends = 2.0 * radius > 1e-30 ? 2.0 * radius : 0.0, arcs = 0.0;
    if (opening < ends) {
        double share = opening > 0.0 ? fmin(opening / ends, 1.0 - 2.220446049250313e-16) : 0.0, ratio = radius / clearance;
        arcs = one_arc(fmin(2.0 * share, 1.0), ratio) + two_arcs(share, ratio);
    }
    return (positive(-opening) + 2.0 * radius * arcs) / (clearance * clearance * clearance);
}

/* ---- one metering edge (section 3) ---- */

typedef struct { double opening, radius, clearance; } edge;

static double tanhc(double y) {
    if (y < 0.02)
        return 1.0 + y * (-1.0 / 3 + y * (2.0 / 15 + y * (-17.0 / 315 + y * (62.0 / 2835 + y * (-1382.0 / 155925
            + y * (21844.0 / 6081075 + y * (-929569.0 / 638512875)))))));
    double s = sqrt(y);
    return tanh(s) / s;
}

/* kg/s along a positive drop; o: the oil upstream, mean: of both pressures. */
static double mass_flow(const P *p, const edge *e, const oil *o, double drop, double mean) {
    double rho = density(p, o, mean), mu = viscosity(p, o, mean), w = p->slot_width;
    double c = e->clearance + p->pressure_clearance * mean, c3 = c * c * c, flow;
    double h2 = square(sqrt(square(positive(e->opening)) + square(c + 2.0 * e->radius)) - 2.0 * e->radius);
    double land_factor = 1.0 + 1.5 * square(p->eccentricity), parallel = p->land_leakage * c3 / 12.0;
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

/* ---- the valve at one operating point ---- */

typedef struct {
    const P *p;
    edge supply[2], back[2]; /* P-A, P-B and A-T, B-T */
    oil fresh;
    double temperature, gauge_supply, gauge_return; /* as the inputs say */
    double ps, pt;                                  /* behind the lines */
    double eta;                                     /* share of the throttling heat that stays in the oil */
    double crossing;                                /* m3/(s Pa) between the ports */
    double load;                                    /* p_A - p_B of a load flow */
    double q[2];                                    /* logits of the port pressures */
    int port;                                       /* whose balance is looked at */
} valve;

static double thinning(const P *p, double t) {
    oil warm = oil_at(p, T_VALVE), own = oil_at(p, t);
    return warm.viscosity / own.viscosity;
}

static void open_valve(valve *v, const P *p, const thermohyd_inputs *in) {
    double warmer = in->temperature - T_VALVE, clearance = p->clearance;
    if (p->thermal_clearance != 0.0) clearance = fmax(clearance + p->thermal_clearance * warmer, SMALLEST_CLEARANCE);
    double null = p->null_bias + p->null_shift_temperature * warmer;
    null += p->null_shift_pressure * (in->supply_pressure - p->null_pressure);
    double x = in->spool_position * p->position_per_input - null - 0.5 * p->hysteresis * in->spool_direction;
    double rs = p->edge_radius + p->supply_edge_wear, rt = p->edge_radius + p->return_edge_wear;
    double us = p->underlap, ut = p->underlap + p->unequal_underlap;
    v->p = p;
    v->supply[0] = (edge){us + x, rs + p->edge_wear_pa, clearance};
    v->supply[1] = (edge){us - x, rs + p->edge_wear_pb, clearance};
    v->back[0] = (edge){ut - x, rt + p->edge_wear_at, clearance};
    v->back[1] = (edge){ut + x, rt + p->edge_wear_bt, clearance};
    v->temperature = in->temperature;
    v->fresh = oil_at(p, in->temperature);
    v->gauge_supply = v->ps = in->supply_pressure;
    v->gauge_return = v->pt = in->return_pressure;
    v->eta = p->heat_retention + p->throttle_heating;
    v->crossing = p->cross_port_leakage != 0.0 ? p->cross_port_leakage * thinning(p, in->temperature) : 0.0;
    v->load = in->pressure_a - in->pressure_b;
}

static int has_lines(const P *p) { return p->flow_saturation != 0.0 || p->supply_droop != 0.0 || p->return_back_pressure != 0.0; }

/* The pressures at the edges where these masses pass the lines. */
static void behind_lines(valve *v, double in, double out) {
    const P *p = v->p;
    double qs = in / density(p, &v->fresh, v->gauge_supply), qt = out / density(p, &v->fresh, v->gauge_return);
    v->ps = v->gauge_supply - p->flow_saturation * qs * fabs(qs) - p->supply_droop * qs;
    v->pt = v->gauge_return + (p->flow_saturation + p->return_back_pressure) * qt * fabs(qt);
}

/* ---- both ports closed ---- */

typedef struct { double up, down, temperature, in, out; } port; /* drops from the supply and to the return; mass flows */

static port port_at(const valve *v, int i, double q) {
    double decay = exp(-q);
    port r;
    r.down = (v->ps - v->pt) / (1.0 + decay);
    r.up = decay * r.down;
    r.temperature = v->temperature;
    if (v->eta != 0.0) r.temperature += v->eta * throttling_rise(v->p, r.up, v->ps - 0.5 * r.up, v->temperature);
    oil o = v->eta != 0.0 ? oil_at(v->p, r.temperature) : v->fresh;
    r.in = mass_flow(v->p, &v->supply[i], &v->fresh, r.up, v->ps - 0.5 * r.up);
    r.out = mass_flow(v->p, &v->back[i], &o, r.down, v->pt + 0.5 * r.down);
    return r;
}

/* ln(in/out) of a port; what crosses over from the other one counts. */
static double imbalance(const valve *v, int i, double q, double q_other) {
    port own = port_at(v, i, q);
    double in = own.in, out = own.out;
    if (v->crossing != 0.0) {
        double whole = v->ps - v->pt, decay = exp(-q_other), down = whole / (1.0 + decay), up = decay * down;
        double fall = own.up + up < own.down + down ? up - own.up : own.down - down; /* own pressure less the other's */
        double m = v->crossing * density(v->p, &v->fresh, v->pt + 0.5 * (own.down + down)) * fall;
        in += positive(-m);
        out += positive(m);
    }
    return log(in / out);
}

static double of_port_b(double q, void *about) { valve *v = about; return imbalance(v, 1, q, v->q[0]); }

static double of_port_a(double q, void *about) {
    valve *v = about;
    v->q[0] = q;
    if (v->crossing != 0.0) v->q[1] = root(of_port_b, v, -BRACKET, BRACKET);
    return imbalance(v, 0, q, v->q[1]);
}

static double balance_closed(valve *v) { /* leaves q; the mass that passes through */
    if (v->ps <= v->pt) return 0.0;
    v->q[0] = v->q[1] = 0.0;
    v->q[0] = root(of_port_a, v, -BRACKET, BRACKET);
    v->q[1] = root(of_port_b, v, -BRACKET, BRACKET);
    return port_at(v, 0, v->q[0]).out + port_at(v, 1, v->q[1]).out;
}

static double closed_through_lines(double m, void *about) {
    valve *v = about;
    behind_lines(v, m, m);
    return balance_closed(v) - m;
}

static void closed(valve *v, thermohyd_outputs *out) {
    double m = balance_closed(v);
    if (has_lines(v->p)) closed_through_lines(root(closed_through_lines, v, 0.0, m), v);
    port r[2];
    double mass = 0.0, heat = 0.0;
    for (int i = 0; i < 2; i++) {
        r[i] = port_at(v, i, v->q[i]);
        double leaving = r[i].temperature;
        if (v->eta != 0.0) leaving += v->eta * throttling_rise(v->p, r[i].down, v->pt + 0.5 * r[i].down, leaving);
        mass += r[i].out;
        heat += r[i].out * leaving;
    }
    oil warm = v->eta != 0.0 ? oil_at(v->p, heat / mass) : v->fresh;
    double drop = v->gauge_supply - v->gauge_return;
    out->blocked_pressure_a = v->pt + r[0].down;
    out->blocked_pressure_b = v->pt + r[1].down;
    out->leakage_flow = mass / density(v->p, &warm, v->gauge_return) + v->p->pilot_leakage * sqrt(drop)
        + v->p->bushing_leakage * drop * thinning(v->p, v->temperature);
}

/* ---- any port pressures ---- */

typedef struct { double in[2], out[2], warm[2], net[2]; } flows; /* net: out of the edges into the load */

static double mixed(const valve *v, const double fed[2], const double back[2], const double hot_fed[2], const double hot_back[2],
                    int i, double brought, double other) {
    double total = fed[i] + back[i] + brought;
    return total > 0.0 ? (fed[i] * hot_fed[i] + back[i] * hot_back[i] + brought * other) / total : v->temperature;
}

/* What flows at these port pressures; of oil that keeps heat, what leaves one port through the load warms the other. */
static flows flows_at(const valve *v, const double pressure[2]) {
    const P *p = v->p;
    flows f;
    double up[2], down[2], fresh_in[2], fresh_out[2], cross = 0.0;
    for (int i = 0; i < 2; i++) {
        up[i] = v->ps - pressure[i];
        down[i] = pressure[i] - v->pt;
        f.in[i] = fresh_in[i] = mass_flow(p, &v->supply[i], &v->fresh, up[i], pressure[i] + 0.5 * up[i]);
        f.out[i] = fresh_out[i] = mass_flow(p, &v->back[i], &v->fresh, down[i], pressure[i] - 0.5 * down[i]);
        f.warm[i] = v->temperature;
    }
    if (v->eta != 0.0) {
        double hot_fed[2], hot_back[2], fed[2], back[2], own[2], spare[2];
        for (int i = 0; i < 2; i++) {
            double supply_mean = pressure[i] + 0.5 * up[i], return_mean = pressure[i] - 0.5 * down[i];
            hot_fed[i] = v->temperature + v->eta * throttling_rise(p, positive(up[i]), supply_mean, v->temperature);
            hot_back[i] = v->temperature + v->eta * throttling_rise(p, positive(-down[i]), return_mean, v->temperature);
            fed[i] = positive(fresh_in[i]);
            back[i] = positive(-fresh_out[i]);
        }
        for (int pass = 0; pass < 2; pass++) {
            for (int i = 0; i < 2; i++) {
                double brought = pass ? spare[1 - i] : 0.0, other = pass ? own[1 - i] : 0.0;
                f.warm[i] = mixed(v, fed, back, hot_fed, hot_back, i, brought, other);
                oil o = oil_at(p, f.warm[i]);
                f.in[i] = up[i] < 0.0 ? mass_flow(p, &v->supply[i], &o, up[i], pressure[i] + 0.5 * up[i]) : fresh_in[i];
                f.out[i] = down[i] < 0.0 ? fresh_out[i] : mass_flow(p, &v->back[i], &o, down[i], pressure[i] - 0.5 * down[i]);
            }
            for (int i = 0; !pass && i < 2; i++) { own[i] = f.warm[i]; spare[i] = positive(f.in[i] - f.out[i]); }
        }
    }
    if (v->crossing != 0.0)
        cross = v->crossing * density(p, &v->fresh, 0.5 * (pressure[0] + pressure[1])) * (pressure[0] - pressure[1]);
    f.net[0] = f.in[0] - f.out[0] - cross;
    f.net[1] = f.in[1] - f.out[1] + cross;
    return f;
}

static void loaded_pressures(const valve *v, double q, double pressure[2]) {
    double low = v->pt - 0.5 * fabs(v->load), span = v->ps - v->pt + fabs(v->load);
    double mean = low + span / (1.0 + exp(-q));
    pressure[0] = mean + 0.5 * v->load;
    pressure[1] = mean - 0.5 * v->load;
}

static double of_loaded(double q, void *about) {
    valve *v = about;
    double pressure[2], in = 0.0, out = 0.0;
    loaded_pressures(v, q, pressure);
    flows f = flows_at(v, pressure);
    for (int i = 0; i < 2; i++) {
        in += positive(f.in[i]) + positive(-f.out[i]);
        out += positive(f.out[i]) + positive(-f.in[i]);
    }
    return log(in / out);
}

static double balance_loaded(valve *v) { /* leaves q[0]; the mass that comes from the supply */
    double pressure[2];
    if (v->ps - v->pt + fabs(v->load) <= 0.0) return 0.0;
    v->q[0] = root(of_loaded, v, -BRACKET, BRACKET);
    loaded_pressures(v, v->q[0], pressure);
    flows f = flows_at(v, pressure);
    return f.in[0] + f.in[1];
}

static double loaded_through_lines(double m, void *about) {
    valve *v = about;
    behind_lines(v, m, m);
    return balance_loaded(v) - m;
}

static void loaded(valve *v, thermohyd_outputs *out) {
    double m = balance_loaded(v), pressure[2];
    if (has_lines(v->p)) loaded_through_lines(root(loaded_through_lines, v, 0.0, m), v);
    loaded_pressures(v, v->q[0], pressure);
    flows f = flows_at(v, pressure);
    double through = 0.5 * (f.net[0] - f.net[1]);
    oil o = v->eta != 0.0 ? oil_at(v->p, through > 0.0 ? f.warm[0] : f.warm[1]) : v->fresh;
    out->load_flow = through / density(v->p, &o, 0.5 * (pressure[0] + pressure[1]));
}

typedef struct { valve *v; const double *pressure; } imposed_ports;

static double from_supply(double m, void *about) {
    imposed_ports *i = about;
    behind_lines(i->v, m, 0.0);
    flows f = flows_at(i->v, i->pressure);
    return f.in[0] + f.in[1] - m;
}

static double to_return(double m, void *about) {
    imposed_ports *i = about;
    behind_lines(i->v, 0.0, m);
    flows f = flows_at(i->v, i->pressure);
    return f.out[0] + f.out[1] - m;
}

static void imposed(valve *v, const thermohyd_inputs *in, thermohyd_outputs *out) {
    const P *p = v->p;
    double pressure[2] = {in->pressure_a, in->pressure_b};
    if (has_lines(p)) { /* each line sees its own flow alone */
        imposed_ports about = {v, pressure};
        double s = root(from_supply, &about, 0.0, from_supply(0.0, &about));
        double t = root(to_return, &about, 0.0, to_return(0.0, &about));
        behind_lines(v, s, t);
    }
    flows f = flows_at(v, pressure);
    oil warm[2], left = v->fresh;
    for (int i = 0; i < 2; i++) warm[i] = v->eta != 0.0 ? oil_at(p, f.warm[i]) : v->fresh;
    if (v->eta != 0.0) {
        double mass = 0.0, heat = 0.0;
        for (int i = 0; i < 2; i++) {
            double down = pressure[i] - v->pt, m = positive(f.out[i]);
            mass += m;
            heat += m * (f.warm[i] + v->eta * throttling_rise(p, down, v->pt + 0.5 * down, f.warm[i]));
        }
        if (mass > 0.0) left = oil_at(p, heat / mass);
    }
    double drop = v->gauge_supply - v->gauge_return;
    double beside = p->pilot_leakage * sqrt(positive(drop)) + p->bushing_leakage * drop * thinning(p, v->temperature);
    out->mass_flow_a = f.net[0];
    out->mass_flow_b = -f.net[1];
    out->flow_a = f.net[0] / density(p, &warm[0], pressure[0]);
    out->flow_b = -f.net[1] / density(p, &warm[1], pressure[1]);
    out->supply_flow = (f.in[0] + f.in[1]) / density(p, &v->fresh, v->gauge_supply) + beside;
    out->return_flow = (f.out[0] + f.out[1]) / density(p, &left, v->gauge_return) + beside;
}

int thermohyd_valve(const P *p, const thermohyd_inputs *in, thermohyd_outputs *out) {
    const double all[] = {in->spool_position, in->spool_direction, in->supply_pressure, in->return_pressure,
                          in->temperature, in->pressure_a, in->pressure_b};
    for (int i = 0; i < 7; i++)
        if (!isfinite(all[i])) return THERMOHYD_BAD_INPUT;
    if (!(in->temperature > 150.0 && in->temperature < 700.0)) return THERMOHYD_BAD_INPUT;
    valve v;
    open_valve(&v, p, in);
    imposed(&v, in, out);
    double span = in->supply_pressure - in->return_pressure;
    if (span == 0.0) { /* a pump at rest */
        out->blocked_pressure_a = out->blocked_pressure_b = in->return_pressure;
        out->leakage_flow = 0.0;
    } else if (span > 0.0) {
        open_valve(&v, p, in);
        closed(&v, out);
    } else {
        out->blocked_pressure_a = out->blocked_pressure_b = out->leakage_flow = out->load_flow = (double)NAN;
        return THERMOHYD_NO_SUPPLY;
    }
    open_valve(&v, p, in);
    if (span + fabs(v.load) > 0.0) loaded(&v, out);
    else out->load_flow = 0.0;
    return THERMOHYD_OK;
}
