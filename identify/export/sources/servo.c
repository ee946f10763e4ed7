/* The servo's equations of motion: command, spool, flows, chambers, piston (docs/physics.md sections 9.1 to 9.4). */
#include "servo.h"

#include "hydraulics.h"

#define PLAY_TIME 1e-4 /* s */
#define SLIDING_SPEED 1e-3
#define STRIBECK_SPEED 10e-3
#define STOP_STIFFNESS 1e8
#define STOP_DAMPING 1e5
#define STOP_CUSHION 10e-6
#define ATMOSPHERE 1.013e5
#define POLYTROPIC 1.4
#define THINNEST_AIR 1e3
#define JET_ANGLE 0.35836794954530027 /* cos 69 deg */

static double clipped(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

/* ---- from the command to the spool ---- */

double thermohyd_null(const P *p, const thermohyd_inputs *in) { return null_of(p, in->supply_pressure, in->temperature); }

double thermohyd_loop_gain(const P *p) { return p->stroke * p->amplifier_gain * p->sensor_gain / p->rated_current; }

double thermohyd_asked(const P *p, double command, double piston) {
    double wanted = command;
    if (THERMOHYD_COMMAND == THERMOHYD_SETPOINT) wanted = thermohyd_loop_gain(p) * (command - piston);
    if (THERMOHYD_COMMAND == THERMOHYD_CURRENT) wanted = p->polarity * p->stroke * command / p->rated_current;
    return clipped(wanted, -p->stroke, p->stroke);
}

/* ---- flows ---- */

typedef struct {
    valve v;
    double pressure[2];
    oil inside[2];
    double in[2], out[2]; /* kg/s along supply, chamber, return */
} circuit;

static const oil *upstream(const circuit *c, int port, int from_supply, double drop) {
    return (drop >= 0.0) == from_supply ? &c->v.fresh : &c->inside[port];
}

static void pass_supply(circuit *c) {
    for (int i = 0; i < 2; i++) {
        double drop = c->v.ps - c->pressure[i];
        c->in[i] = mass_flow(c->v.p, &c->v.supply[i], upstream(c, i, 1, drop), drop, 0.5 * (c->v.ps + c->pressure[i]));
    }
}

static void pass_return(circuit *c) {
    for (int i = 0; i < 2; i++) {
        double drop = c->pressure[i] - c->v.pt;
        c->out[i] = mass_flow(c->v.p, &c->v.back[i], upstream(c, i, 0, drop), drop, 0.5 * (c->pressure[i] + c->v.pt));
    }
}

/* m3/s at the return's gauge, of oil as warm as both chambers send it. */
static double returned(const circuit *c) {
    const P *p = c->v.p;
    oil left = c->v.fresh;
    if (THERMOHYD_KEEPS_HEAT) {
        double mass = 0.0, heat = 0.0;
        for (int i = 0; i < 2; i++) {
            double m = positive(c->out[i]) + 1e-30, t = c->inside[i].temperature;
            mass += m;
            heat += m * (t + throttling_rise(p, c->pressure[i] - c->v.pt, 0.5 * (c->pressure[i] + c->v.pt), t));
        }
        left = oil_at(p, heat / mass);
    }
    return (c->out[0] + c->out[1]) / density(p, &left, c->v.gauge_return);
}

static double supplied(const circuit *c) { return (c->in[0] + c->in[1]) / density(c->v.p, &c->v.fresh, c->v.gauge_supply); }

static double of_supply(double flow, void *about) {
    circuit *c = about;
    double pt = c->v.pt;
    lose(&c->v, flow, 0.0);
    c->v.pt = pt;
    pass_supply(c);
    return supplied(c) - flow;
}

static double of_return(double flow, void *about) {
    circuit *c = about;
    double ps = c->v.ps;
    lose(&c->v, 0.0, flow);
    c->v.ps = ps;
    pass_return(c);
    return returned(c) - flow;
}

/* Flows through all edges; each line sees its own flow alone, and more of it leaves less. */
static void pass(circuit *c) {
    pass_supply(c);
    pass_return(c);
    if (!has_lines(c->v.p)) return;
    of_supply(root(of_supply, c, 0.0, supplied(c)), c);
    of_return(root(of_return, c, 0.0, returned(c)), c);
}

/* Force of the jets on the spool per its coefficient; oil over the lands between the slots makes none. */
static double jets(const circuit *c) {
    const P *p = c->v.p;
    double sum = 0.0;
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 2; k++) { /* from the supply; to the return */
            double drop = k ? c->pressure[i] - c->v.pt : c->v.ps - c->pressure[i];
            double mean = 0.5 * (c->pressure[i] + (k ? c->v.pt : c->v.ps));
            const oil *o = upstream(c, i, !k, drop);
            double rho = density(p, o, mean), m = edge_flow(p, k ? &c->v.back[i] : &c->v.supply[i], o, drop, mean, 0.0);
            sum += (i == k ? 1.0 : -1.0) * fabs(m) / rho * sqrt(2.0 * rho * fabs(drop));
        }
    return JET_ANGLE * sum;
}

/* ---- on the piston ---- */

static double thrust(const P *p, const thermohyd_inputs *in, const double s[]) {
    double v = s[VELOCITY], z = s[PISTON], end = 0.5 * p->piston_stroke, sliding = tanh(v / SLIDING_SPEED);
    double force = p->piston_area_a * s[PRESSURE_A] - p->piston_area_b * s[PRESSURE_B] - p->viscous_friction * v;
    force -= (p->coulomb_friction + p->stribeck_friction * exp(-square(v / STRIBECK_SPEED))) * sliding;
    for (int side = -1; side < 2; side += 2) {
        double depth = side * z - end, damping = STOP_DAMPING * clipped(depth / STOP_CUSHION, 0.0, 1.0);
        force -= side * positive(STOP_STIFFNESS * depth + damping * side * v);
    }
    return force - in->external_force;
}

/* ---- in the chambers ---- */

static double with_air(double beta, double share, double pressure) {
    double absolute = fmax(pressure + ATMOSPHERE, THINNEST_AIR);
    double air = share * pow(ATMOSPHERE / absolute, 1.0 / POLYTROPIC);
    return (1.0 - share + air) / ((1.0 - share) / beta + air / (POLYTROPIC * absolute));
}

static void chambers(circuit *c, const thermohyd_inputs *in, const double s[], thermohyd_instant *now) {
    const P *p = c->v.p;
    const double area[2] = {p->piston_area_a, p->piston_area_b}, middle[2] = {p->chamber_volume_a, p->chamber_volume_b};
    const double *pressure = c->pressure;
    double mean = 0.5 * (pressure[0] + pressure[1]), between = p->jack_leakage + c->v.crossing;
    const oil *sent = &c->inside[pressure[0] > pressure[1] ? 0 : 1];
    double across = density(p, sent, mean) * between * (pressure[1] - pressure[0]); /* into A */
    for (int i = 0; i < 2; i++) {
        double side = i ? -1.0 : 1.0, crossed = side * across, warmth = c->inside[i].temperature;
        double room = middle[i] + side * area[i] * s[PISTON], rho = density(p, &c->inside[i], pressure[i]);
        double shrunk = squeezed(p, &c->inside[i], pressure[i]);
        double stiff = shrunk * (c->inside[i].modulus + (1.0 + p->tait_slope) * pressure[i]);
        now->squeeze[i] = ((c->in[i] - c->out[i] + crossed) / rho - side * area[i] * s[VELOCITY]) / room;
        double beta = stiff * p->bulk_modulus_factor;
        if (p->entrained_air != 0.0) beta = with_air(beta, p->entrained_air, pressure[i]);
        if (!THERMOHYD_KEEPS_HEAT) {
            now->rate[PRESSURE_A + i] = beta * now->squeeze[i];
            continue;
        }
        const double entering[3] = {c->in[i], -c->out[i], crossed};
        const double from[3] = {in->temperature, in->temperature, c->inside[1 - i].temperature};
        const double drop[3] = {c->v.ps - pressure[i], c->v.pt - pressure[i], pressure[1 - i] - pressure[i]};
        const double middles[3] = {0.5 * (c->v.ps + pressure[i]), 0.5 * (c->v.pt + pressure[i]), mean};
        double warming = 0.0, entered = 0.0, mass = rho * room;
        for (int k = 0; k < 3; k++) {
            if (!(entering[k] > 0.0)) continue;
            entered += entering[k];
            warming += entering[k] * (from[k] + throttling_rise(p, drop[k], middles[k], from[k]) - warmth);
        }
        double heat = p->specific_heat + p->specific_heat_slope * (warmth - T_OIL), capacity = mass * heat;
        now->heating[i] = warming / mass + p->wall_heat * (in->temperature - warmth) / capacity;
        now->renewal[i] = entered / mass + p->wall_heat / capacity;
        /* dp = beta (squeeze + alpha dT) and dT = heating + k dp are two linear equations. */
        double alpha = p->expansion * p->density / c->inside[i].density - p->bulk_modulus_decay * pressure[i] / stiff;
        double k = alpha * warmth / (rho * heat);
        double dp = beta * (now->squeeze[i] + alpha * now->heating[i]) / (1.0 - beta * alpha * k);
        now->rate[PRESSURE_A + i] = dp;
        now->rate[TEMPERATURE_A + i] = now->heating[i] + k * dp;
    }
}

void thermohyd_instant_at(const P *p, const thermohyd_inputs *in, const double s[], thermohyd_instant *now) {
    circuit c;
    open_edges(&c.v, p, s[SPOOL], in->supply_pressure, in->return_pressure, in->temperature);
    for (int i = 0; i < 2; i++) {
        c.pressure[i] = s[PRESSURE_A + i];
        c.inside[i] = THERMOHYD_KEEPS_HEAT ? oil_at(p, s[TEMPERATURE_A + i]) : c.v.fresh;
    }
    pass(&c);
    chambers(&c, in, s, now);
    now->supplied = supplied(&c) + beside_the_spool(&c.v);
    now->returned = returned(&c) + beside_the_spool(&c.v);
    now->jets = p->flow_force != 0.0 ? jets(&c) : 0.0;
    now->thrust = thrust(p, in, s);
    now->target = thermohyd_asked(p, in->command, s[PISTON]);
#if THERMOHYD_PLAY
    double ahead = now->target - s[PLAY], within = clipped(ahead, -0.5 * p->backlash, 0.5 * p->backlash);
    now->target -= within;
    now->rate[PLAY] = (ahead - within) / PLAY_TIME;
#endif
    now->target -= p->flow_force * now->jets;
    double omega = 2.0 * PI * p->spool_frequency;
    now->rate[SPOOL] = s[SPOOL_SPEED];
    now->rate[SPOOL_SPEED] = omega * omega * (now->target - s[SPOOL]) - 2.0 * p->spool_damping * omega * s[SPOOL_SPEED];
    now->rate[PISTON] = s[VELOCITY];
    now->rate[VELOCITY] = now->thrust / p->moving_mass;
}

void thermohyd_scaling(const P *p, const thermohyd_inputs *in, thermohyd_scale *scale) {
    double *origin = scale->origin, *size = scale->size;
    oil fresh = oil_at(p, in->temperature);
    double span = in->supply_pressure - in->return_pressure, rho = density(p, &fresh, in->supply_pressure);
    double area = 0.5 * (p->piston_area_a + p->piston_area_b), omega = 2.0 * PI * p->spool_frequency;
    double speed = p->discharge_coefficient * p->slot_width * p->stroke * sqrt(span / rho) / area;
    for (int i = 0; i < THERMOHYD_STATES; i++) {
        origin[i] = 0.0;
        size[i] = THERMOHYD_PLAY && i == PLAY ? p->stroke : 10.0; /* K */
        if (i >= TEMPERATURE_A && size[i] == 10.0) origin[i] = in->temperature;
    }
    size[SPOOL] = p->stroke;
    size[SPOOL_SPEED] = p->stroke * omega;
    size[PISTON] = speed / omega;
    size[VELOCITY] = speed;
    size[PRESSURE_A] = size[PRESSURE_B] = 0.1 * span;
    origin[PRESSURE_A] = origin[PRESSURE_B] = 0.5 * (in->supply_pressure + in->return_pressure);
}
