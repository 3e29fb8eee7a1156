/* A co-simulation host without Python: loads the binary of an FMI 2 FMU and prints what a test wants to know.
 *
 *   host LIBRARY GUID run STEPS LENGTH                  outputs at the end, as hexadecimal doubles
 *   host LIBRARY GUID instances COUNT STEPS             the same for interleaved instances; all must agree with a lone one
 *   host LIBRARY GUID threads COUNT STEPS               the same for instances on threads of their own
 *   host LIBRARY GUID reload TIMES                      open file descriptors gained by loading, running and unloading
 *   host LIBRARY GUID long STEPS                        growth of resident memory in kB; nanoseconds for each step
 *
 * The reference of the input and those of the outputs follow as INPUT OUTPUT..., the input is driven with a wave. */

#include <dirent.h>
#include <dlfcn.h>
#include <math.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "fmi2Functions.h"

#define OUTPUTS 16

static const char *library, *guid;
static fmi2ValueReference input, output[OUTPUTS];
static size_t outputs;

typedef struct {
  void *handle;
  fmi2InstantiateTYPE *instantiate; fmi2FreeInstanceTYPE *release; fmi2SetupExperimentTYPE *setup;
  fmi2EnterInitializationModeTYPE *enter; fmi2ExitInitializationModeTYPE *leave; fmi2TerminateTYPE *terminate;
  fmi2SetRealTYPE *set; fmi2GetRealTYPE *get; fmi2DoStepTYPE *step;
} fmu;

static void fail(const char *what) { fprintf(stderr, "%s\n", what); exit(3); }

static void logger(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...) {
  va_list rest;
  (void)e; (void)status; (void)category;
  fprintf(stderr, "%s: ", name);
  va_start(rest, text);
  vfprintf(stderr, text, rest);
  va_end(rest);
  fprintf(stderr, "\n");
}

static const fmi2CallbackFunctions calls = {logger, calloc, free, 0, 0};

#define LOAD(field, name) if (!(*(void **)&f.field = dlsym(f.handle, name))) fail(name)

static fmu load(void) {
  fmu f;
  f.handle = dlopen(library, RTLD_NOW | RTLD_LOCAL);
  if (!f.handle) fail(dlerror());
  LOAD(instantiate, "fmi2Instantiate"); LOAD(release, "fmi2FreeInstance"); LOAD(setup, "fmi2SetupExperiment");
  LOAD(enter, "fmi2EnterInitializationMode"); LOAD(leave, "fmi2ExitInitializationMode");
  LOAD(terminate, "fmi2Terminate"); LOAD(set, "fmi2SetReal"); LOAD(get, "fmi2GetReal"); LOAD(step, "fmi2DoStep");
  return f;
}

static fmi2Component begin(const fmu *f) {
  fmi2Component c = f->instantiate("host", fmi2CoSimulation, guid, 0, &calls, 0, 0);
  if (!c) fail("no instance");
  if (f->setup(c, 0, 0, 0, 0, 0) || f->enter(c) || f->leave(c)) fail("no start");
  return c;
}

static void advance(const fmu *f, fmi2Component c, long k, double length, double phase) {
  const double u = sin(0.01 * (double)(k - k % 7) + phase);
  if (input && f->set(c, &input, 1, &u)) fail("no input");
  if (f->step(c, (double)k * length, length, fmi2True)) fail("no step");
}

static void show(const fmu *f, fmi2Component c) {
  double y[OUTPUTS];
  if (f->get(c, output, outputs, y)) fail("no output");
  for (size_t i = 0; i < outputs; i++) printf("%a ", y[i]);
  printf("\n");
}

static void lone(const fmu *f, long steps, double length, double phase, double *y) {
  fmi2Component c = begin(f);
  for (long k = 0; k < steps; k++) advance(f, c, k, length, phase);
  if (f->get(c, output, outputs, y)) fail("no output");
  if (f->terminate(c)) fail("no end");
  f->release(c);
}

static void instances(long count, long steps) {
  fmu f = load();
  fmi2Component *c = calloc((size_t)count, sizeof *c);
  double y[OUTPUTS], expected[OUTPUTS];
  for (long i = 0; i < count; i++) c[i] = begin(&f);
  for (long k = 0; k < steps; k++)
    for (long i = 0; i < count; i++) advance(&f, c[i], k, 1e-3, (double)(i % 5));
  long wrong = 0;
  for (long i = 0; i < count; i++) {
    lone(&f, steps, 1e-3, (double)(i % 5), expected);
    f.get(c[i], output, outputs, y);
    wrong += memcmp(y, expected, outputs * sizeof *y) != 0;
    f.release(c[i]);
  }
  free(c);
  printf("%ld\n", wrong);
}

typedef struct { fmu f; long steps; double phase, y[OUTPUTS]; } job;
static void *work(void *j) { job *a = j; lone(&a->f, a->steps, 1e-3, a->phase, a->y); return 0; }

static void threads(long count, long steps) {
  job *jobs = calloc((size_t)count, sizeof *jobs);
  pthread_t *id = calloc((size_t)count, sizeof *id);
  double expected[OUTPUTS];
  long wrong = 0;
  for (long i = 0; i < count; i++) {
    jobs[i].f = load(); jobs[i].steps = steps; jobs[i].phase = (double)i;
    pthread_create(&id[i], 0, work, &jobs[i]);
  }
  for (long i = 0; i < count; i++) pthread_join(id[i], 0);
  for (long i = 0; i < count; i++) {
    lone(&jobs[i].f, steps, 1e-3, (double)i, expected);
    wrong += memcmp(jobs[i].y, expected, outputs * sizeof *expected) != 0;
  }
  free(jobs);
  free(id);
  printf("%ld\n", wrong);
}

static long descriptors(void) {
  long n = 0;
  DIR *folder = opendir("/proc/self/fd");
  while (readdir(folder)) n++;
  closedir(folder);
  return n;
}

static long resident(void) {
  long kb = 0;
  char line[200];
  FILE *file = fopen("/proc/self/smaps_rollup", "r");        /* heap and stacks, without pages of files */
  while (fgets(line, sizeof line, file)) if (sscanf(line, "Anonymous: %ld", &kb) == 1) break;
  fclose(file);
  return kb;
}

static void reload(long times) {
  double y[OUTPUTS];
  const long before = descriptors();
  for (long i = 0; i < times; i++) {
    fmu f = load();
    lone(&f, 3, 1e-3, 0, y);
    dlclose(f.handle);
  }
  printf("%ld\n", descriptors() - before);
}

static void endure(long steps) {
  struct timespec a, b;
  fmu f = load();
  fmi2Component c = begin(&f);
  clock_gettime(CLOCK_MONOTONIC, &a);
  for (long k = 0; k < 5000; k++) advance(&f, c, k, 1e-3, 0);
  resident();                                                  /* its own pages come in now */
  const long before = resident();
  clock_gettime(CLOCK_MONOTONIC, &a);
  for (long k = 5000; k < 5000 + steps; k++) advance(&f, c, k, 1e-3, 0);
  clock_gettime(CLOCK_MONOTONIC, &b);
  printf("%ld %.1f\n", resident() - before,
         ((double)(b.tv_sec - a.tv_sec) * 1e9 + (double)(b.tv_nsec - a.tv_nsec)) / (double)steps);
  f.release(c);
}

int main(int n, char **a) {
  if (n < 6) fail("usage: see the source");
  library = a[1]; guid = a[2];
  const char *what = a[3];
  const long first = atol(a[4]);
  const int two = !strcmp(what, "run") || !strcmp(what, "instances") || !strcmp(what, "threads");
  const int at = two ? 6 : 5;
  input = (fmi2ValueReference)atol(a[at]);
  for (int i = at + 1; i < n && outputs < OUTPUTS; i++) output[outputs++] = (fmi2ValueReference)atol(a[i]);
  if (!strcmp(what, "run")) {
    fmu f = load();
    fmi2Component c = begin(&f);
    for (long k = 0; k < first; k++) advance(&f, c, k, atof(a[5]), 0);
    show(&f, c);
    f.release(c);
  } else if (!strcmp(what, "instances")) instances(first, atol(a[5]));
  else if (!strcmp(what, "threads")) threads(first, atol(a[5]));
  else if (!strcmp(what, "reload")) reload(first);
  else if (!strcmp(what, "long")) endure(first);
  else fail("unknown command");
  return 0;
}
