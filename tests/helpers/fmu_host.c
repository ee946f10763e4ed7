/* A host of FMUs in C, without Python: loads a binary, sets inputs from stdin line by line, prints outputs. FMI 2.0 co-simulation.

   binary GUID inputs outputs: a line of inputs per step of 1 ms, outputs after it. With "steps" behind: a line holds the
   inputs of a row, their slopes until the next one and how long that is, outputs are printed at each row, and it is done in so many steps. With
   "gain piston velocity" behind that: the host closes the loop, the first input being gain (setpoint - piston), of outputs by number. */
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>

typedef struct { void (*logger)(void *, const char *, int, const char *, const char *, ...); void *(*allocate)(size_t, size_t);
                 void (*release)(void *); void (*finished)(void *, int); void *host; } callbacks;

static void logger(void *host, const char *name, int status, const char *category, const char *message, ...) {
    (void)host; (void)category;
    fprintf(stderr, "%s: %d: %s\n", name, status, message);
}

int main(int argc, char **argv) {
    void *binary = argc > 4 ? dlopen(argv[1], RTLD_NOW) : NULL;
    if (!binary) { fprintf(stderr, "%s\n", dlerror()); return 1; }
    void *(*instantiate)(const char *, int, const char *, const char *, const callbacks *, int, int) = dlsym(binary, "fmi2Instantiate");
    int (*begin)(void *) = dlsym(binary, "fmi2EnterInitializationMode"), (*ready)(void *) = dlsym(binary, "fmi2ExitInitializationMode");
    int (*set)(void *, const unsigned *, size_t, const double *) = dlsym(binary, "fmi2SetReal");
    int (*get)(void *, const unsigned *, size_t, double *) = dlsym(binary, "fmi2GetReal");
    int (*slope)(void *, const unsigned *, size_t, const int *, const double *) = dlsym(binary, "fmi2SetRealInputDerivatives");
    int (*step)(void *, double, double, int) = dlsym(binary, "fmi2DoStep");
    void (*leave)(void *) = dlsym(binary, "fmi2FreeInstance");
    callbacks host = {logger, calloc, free, NULL, NULL};
    void *model = instantiate("model", 1, argv[2], "", &host, 0, 1);
    unsigned inputs[16], outputs[16];
    int first_order[16], rows = argc > 5, loop = argc > 8;
    size_t n = (size_t)atoi(argv[3]), m = (size_t)atoi(argv[4]);
    for (unsigned i = 0; i < 16; i++) { inputs[i] = 1000 + i; outputs[i] = 2000 + i; first_order[i] = 1; }
    double value[16], rate[16], now[16], found[16], time = 0.0, row = 1e-3, gain = loop ? atof(argv[6]) : 0.0;
    int steps = rows ? atoi(argv[5]) : 1, piston = loop ? atoi(argv[7]) : 0, velocity = loop ? atoi(argv[8]) : 0, started = 0;
    if (!model || begin(model)) return 2;
    if (!rows && (started = 1, ready(model))) return 2;
    for (;;) {
        for (size_t i = 0; i < n; i++) if (scanf("%lf", value + i) != 1) { leave(model); return 0; }
        for (size_t i = 0; i < n; i++) if (rows && scanf("%lf", rate + i) != 1) return 4;
        if (rows && scanf("%lf", &row) != 1) return 4;
        if (!started && (set(model, inputs, n, value) || ready(model))) return 2;
        started = 1;
        for (int k = 0; k < steps; k++, time += row / steps) {
            if (rows && get(model, outputs, m, found)) return 3;
            for (size_t i = 0; rows && k == 0 && i < m; i++) printf("%.17g%c", found[i], i + 1 < m ? ' ' : '\n');
            for (size_t i = 0; i < n; i++) now[i] = value[i] + (rows ? rate[i] * k * row / steps : 0.0);
            double asked = rate[0];
            if (loop) { now[0] = gain * (now[0] - found[piston]); rate[0] = gain * (rate[0] - found[velocity]); }
            if (set(model, inputs, n, now) || (rows && slope(model, inputs, n, first_order, rate))) return 3;
            rate[0] = asked;
            if (step(model, time, row / steps, 1)) return 3;
        }
        if (rows) continue;
        if (get(model, outputs, m, found)) return 3;
        for (size_t i = 0; i < m; i++) printf("%.17g%c", found[i], i + 1 < m ? ' ' : '\n');
    }
}
