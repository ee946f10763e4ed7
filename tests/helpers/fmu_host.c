/* A host of FMUs in C, without Python: loads a binary, sets inputs from stdin line by line, prints outputs. Co-simulation,
   FMI 2.0 or, where the binary has its functions, 3.0, in which inputs have no slopes and stand over a step.

   binary GUID inputs outputs: a line of inputs per step of 1 ms, outputs after it. With "steps" behind: a line holds the
   inputs of a row, their slopes until the next one and how long that is, outputs are printed at each row, and it is done in so many steps. With
   "gain piston velocity" behind that: the host closes the loop, the first input being gain (setpoint - piston), of outputs by number. */
#include <dlfcn.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

typedef struct { void (*logger)(void *, const char *, int, const char *, const char *, ...); void *(*allocate)(size_t, size_t);
                 void (*release)(void *); void (*finished)(void *, int); void *host; } callbacks;

static void logger(void *host, const char *name, int status, const char *category, const char *message, ...) {
    (void)host; (void)category;
    fprintf(stderr, "%s: %d: %s\n", name, status, message);
}

static void log_message(void *host, int status, const char *category, const char *message) {
    logger(host, "model", status, category, message);
}

/* The functions that are called, of either version. */
typedef struct {
    int (*set)(void *, const unsigned *, size_t, const double *), (*get)(void *, const unsigned *, size_t, double *);
    int (*step)(void *, double, double, int), (*begin)(void *), (*ready)(void *);
    int (*slope)(void *, const unsigned *, size_t, const int *, const double *);
    void (*leave)(void *);
} functions;

static int (*set3)(void *, const unsigned *, size_t, const double *, size_t), (*get3)(void *, const unsigned *, size_t, double *, size_t);
static int (*step3)(void *, double, double, bool, bool *, bool *, bool *, double *), (*begin3)(void *, bool, double, double, bool, double);
static int set_of_3(void *model, const unsigned *vr, size_t n, const double *value) { return set3(model, vr, n, value, n); }
static int get_of_3(void *model, const unsigned *vr, size_t n, double *value) { return get3(model, vr, n, value, n); }
static int begin_of_3(void *model) { return begin3(model, false, 0.0, 0.0, false, 0.0); }
static int step_of_3(void *model, double time, double step, int forward) {
    bool event = false, ended = false, early = false;
    double last = time;
    int status = step3(model, time, step, forward, &event, &ended, &early, &last);
    return status || event || ended || early ? 1 : 0;
}
static int no_slope(void *model, const unsigned *vr, size_t n, const int *order, const double *value) {
    (void)model; (void)vr; (void)n; (void)order; (void)value;
    return 0;
}

static functions of_binary(void *binary) {
    functions of = {.leave = dlsym(binary, "fmi2FreeInstance")};
    if (of.leave) {
        of.begin = dlsym(binary, "fmi2EnterInitializationMode");
        of.ready = dlsym(binary, "fmi2ExitInitializationMode");
        of.set = dlsym(binary, "fmi2SetReal");
        of.get = dlsym(binary, "fmi2GetReal");
        of.slope = dlsym(binary, "fmi2SetRealInputDerivatives");
        of.step = dlsym(binary, "fmi2DoStep");
        return of;
    }
    set3 = dlsym(binary, "fmi3SetFloat64");
    get3 = dlsym(binary, "fmi3GetFloat64");
    step3 = dlsym(binary, "fmi3DoStep");
    begin3 = dlsym(binary, "fmi3EnterInitializationMode");
    return (functions){set_of_3, get_of_3, step_of_3, begin_of_3, dlsym(binary, "fmi3ExitInitializationMode"), no_slope,
                       dlsym(binary, "fmi3FreeInstance")};
}

static void *instance_of(void *binary, const char *token) {
    void *(*two)(const char *, int, const char *, const char *, const callbacks *, int, int) = dlsym(binary, "fmi2Instantiate");
    void *(*three)(const char *, const char *, const char *, bool, bool, bool, bool, const unsigned *, size_t, void *,
                   void (*)(void *, int, const char *, const char *), void *) = dlsym(binary, "fmi3InstantiateCoSimulation");
    static const callbacks host = {logger, calloc, free, NULL, NULL};
    if (two) return two("model", 1, token, "", &host, 0, 1);
    return three ? three("model", token, "", false, true, false, false, NULL, 0, NULL, log_message, NULL) : NULL;
}

int main(int argc, char **argv) {
    void *binary = argc > 4 ? dlopen(argv[1], RTLD_NOW) : NULL;
    if (!binary) { fprintf(stderr, "%s\n", dlerror()); return 1; }
    functions of = of_binary(binary);
    void *model = instance_of(binary, argv[2]);
    unsigned inputs[16], outputs[16];
    int first_order[16], rows = argc > 5, loop = argc > 8;
    size_t n = (size_t)atoi(argv[3]), m = (size_t)atoi(argv[4]);
    for (unsigned i = 0; i < 16; i++) { inputs[i] = 1000 + i; outputs[i] = 2000 + i; first_order[i] = 1; }
    double value[16], rate[16], now[16], found[16], time = 0.0, row = 1e-3, gain = loop ? atof(argv[6]) : 0.0;
    int steps = rows ? atoi(argv[5]) : 1, piston = loop ? atoi(argv[7]) : 0, velocity = loop ? atoi(argv[8]) : 0, started = 0;
    if (!model || of.begin(model)) return 2;
    if (!rows && (started = 1, of.ready(model))) return 2;
    for (;;) {
        for (size_t i = 0; i < n; i++) if (scanf("%lf", value + i) != 1) { of.leave(model); return 0; }
        for (size_t i = 0; i < n; i++) if (rows && scanf("%lf", rate + i) != 1) return 4;
        if (rows && scanf("%lf", &row) != 1) return 4;
        if (!started && (of.set(model, inputs, n, value) || of.ready(model))) return 2;
        started = 1;
        for (int k = 0; k < steps; k++, time += row / steps) {
            if (rows && of.get(model, outputs, m, found)) return 3;
            for (size_t i = 0; rows && k == 0 && i < m; i++) printf("%.17g%c", found[i], i + 1 < m ? ' ' : '\n');
            for (size_t i = 0; i < n; i++) now[i] = value[i] + (rows ? rate[i] * k * row / steps : 0.0);
            double asked = rate[0];
            if (loop) { now[0] = gain * (now[0] - found[piston]); rate[0] = gain * (rate[0] - found[velocity]); }
            if (of.set(model, inputs, n, now) || (rows && of.slope(model, inputs, n, first_order, rate))) return 3;
            rate[0] = asked;
            if (of.step(model, time, row / steps, 1)) return 3;
        }
        if (rows) continue;
        if (of.get(model, outputs, m, found)) return 3;
        for (size_t i = 0; i < m; i++) printf("%.17g%c", found[i], i + 1 < m ? ' ' : '\n');
    }
}
