/* A host of FMUs in C, without Python: loads a binary, sets inputs from stdin line by line, prints outputs. FMI 2.0 co-simulation. */
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>

typedef struct { void (*logger)(void *, const char *, int, const char *, const char *, ...); void *(*allocate)(size_t, size_t);
                 void (*release)(void *); void (*finished)(void *, int); void *host; } callbacks;

static void logger(void *host, const char *name, int status, const char *category, const char *message, ...) {
    (void)host; (void)category;
    fprintf(stderr, "%s: %d: %s\n", name, status, message);
}

int main(int argc, char **argv) { /* binary GUID number-of-inputs number-of-outputs */
    void *binary = argc > 4 ? dlopen(argv[1], RTLD_NOW) : NULL;
    if (!binary) { fprintf(stderr, "%s\n", dlerror()); return 1; }
    void *(*instantiate)(const char *, int, const char *, const char *, const callbacks *, int, int) = dlsym(binary, "fmi2Instantiate");
    int (*begin)(void *) = dlsym(binary, "fmi2EnterInitializationMode"), (*ready)(void *) = dlsym(binary, "fmi2ExitInitializationMode");
    int (*set)(void *, const unsigned *, size_t, const double *) = dlsym(binary, "fmi2SetReal");
    int (*get)(void *, const unsigned *, size_t, double *) = dlsym(binary, "fmi2GetReal");
    int (*step)(void *, double, double, int) = dlsym(binary, "fmi2DoStep");
    void (*leave)(void *) = dlsym(binary, "fmi2FreeInstance");
    callbacks host = {logger, calloc, free, NULL, NULL};
    void *model = instantiate("valve", 1, argv[2], "", &host, 0, 1);
    if (!model || begin(model) || ready(model)) return 2;
    unsigned inputs[16], outputs[16];
    size_t n = (size_t)atoi(argv[3]), m = (size_t)atoi(argv[4]);
    for (unsigned i = 0; i < 16; i++) { inputs[i] = 1000 + i; outputs[i] = 2000 + i; }
    double value[16], found[16], time = 0.0;
    for (;; time += 1e-3) {
        for (size_t i = 0; i < n; i++)
            if (scanf("%lf", value + i) != 1) { leave(model); return 0; }
        if (set(model, inputs, n, value) || step(model, time, 1e-3, 1) || get(model, outputs, m, found)) return 3;
        for (size_t i = 0; i < m; i++) printf("%.17g%c", found[i], i + 1 < m ? ' ' : '\n');
    }
}
