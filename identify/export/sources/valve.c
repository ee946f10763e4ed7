/* A servovalve's static flows: oil, edge laws, port balances and effects (docs/physics.md sections 2 to 5, 8).

   One port balance is one falling function of the logit of a pressure's share between return and supply, and its root is found by
   Brent's method to rounding. Lines and a path between the ports nest such roots. Nothing is kept between calls. */
#include "valve.h"

#include "hydraulics.h"

#define BRACKET 40.0

static void open_valve(valve *v, const P *p, const thermohyd_inputs *in) {
    double x = in->spool_position * p->position_per_input - 0.5 * p->hysteresis * in->spool_direction;
    open_edges(v, p, x, in->supply_pressure, in->return_pressure, in->temperature);
    v->eta = p->heat_retention + p->throttle_heating;
    v->load = in->pressure_a - in->pressure_b;
}

/* The pressures at the edges where these masses pass the lines. */
static void behind_lines(valve *v, double in, double out) {
    lose(v, in / density(v->p, &v->fresh, v->gauge_supply), out / density(v->p, &v->fresh, v->gauge_return));
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
    out->blocked_pressure_a = v->pt + r[0].down;
    out->blocked_pressure_b = v->pt + r[1].down;
    out->leakage_flow = mass / density(v->p, &warm, v->gauge_return) + beside_the_spool(v);
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
    double beside = beside_the_spool(v);
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
