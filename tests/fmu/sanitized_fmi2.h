/* FMI 2 for sanitized.c. */

#include <stdarg.h>

#include "fmi2Functions.h"

typedef fmi2Component instance;

static void logger(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...) {
  (void)e;
  must(name && category && status >= fmi2OK && status <= fmi2Fatal);
  said(text);
}

static void *nothing(size_t n, size_t size) { (void)n; (void)size; return 0; }

static const fmi2CallbackFunctions calls = {logger, calloc, free, 0, 0}, own_memory = {logger, 0, 0, 0, 0},
                                   silent = {0, calloc, free, 0, 0}, full = {logger, nothing, free, 0, 0};

static instance make(const char *name, const char *token, int kind, int logging) {
  return fmi2Instantiate(name, kind == EXCHANGE ? fmi2ModelExchange : fmi2CoSimulation, token, 0, &calls, 0, logging);
}

static void no_more_instances(void) {
  must(!fmi2Instantiate("x", fmi2CoSimulation, guid, 0, 0, 0, 1));
  must(!fmi2Instantiate("x", (fmi2Type)7, guid, 0, &calls, 0, 1));
  must(!fmi2Instantiate("x", fmi2CoSimulation, guid, 0, &full, 0, 1));
  must(!fmi2Instantiate(0, fmi2CoSimulation, guid, 0, &silent, 0, 1));
  instance c = fmi2Instantiate("x", fmi2CoSimulation, guid, "file:///nowhere", &own_memory, 1, 1);
  fmi2FreeInstance(c);
  c = fmi2Instantiate("x", fmi2CoSimulation, guid, 0, &silent, 0, 1);
  must(c && fmi2DoStep(c, 0, 1, 0) == fmi2Error);
  fmi2FreeInstance(c);
  must(!strcmp(fmi2GetVersion(), "2.0") && !strcmp(fmi2GetTypesPlatform(), "default"));
  fmi2Status status = fmi2OK;
  fmi2Real real = 0;
  fmi2Integer integer = 0;
  fmi2Boolean boolean = 0;
  fmi2String string = 0;
  const unsigned vr = 0;
  must(fmi2SetDebugLogging(0, 1, 0, 0) && fmi2CancelStep(0) && fmi2GetStatus(0, fmi2DoStepStatus, &status));
  must(fmi2GetRealStatus(0, fmi2LastSuccessfulTime, &real) && fmi2GetIntegerStatus(0, fmi2DoStepStatus, &integer));
  must(fmi2GetBooleanStatus(0, fmi2Terminated, &boolean) && fmi2GetStringStatus(0, fmi2PendingStatus, &string));
  must(fmi2GetBoolean(0, &vr, 1, &boolean) && fmi2GetString(0, &vr, 1, &string) && fmi2GetInteger(0, &vr, 1, &integer));
  must(fmi2SetBoolean(0, &vr, 1, &boolean) && fmi2SetString(0, &vr, 1, &string) && fmi2SetInteger(0, &vr, 1, &integer));
  must(fmi2SetRealInputDerivatives(0, &vr, 1, &integer, &real) && fmi2GetRealOutputDerivatives(0, &vr, 1, &integer, &real));
}

static void release(instance c) { fmi2FreeInstance(c); }
static int enter(instance c, double start, int with_stop, double stop) {
  const int status = fmi2SetupExperiment(c, 1, 1e-6, start, with_stop, stop);
  return status ? status : fmi2EnterInitializationMode(c);
}
static int leave(instance c) { return fmi2ExitInitializationMode(c); }
static int end(instance c) { return fmi2Terminate(c); }
static int reset(instance c) { return fmi2Reset(c); }
static int get(instance c, const unsigned *vr, size_t n, double *v) { return fmi2GetReal(c, vr, n, v); }
static int set(instance c, const unsigned *vr, size_t n, const double *v) { return fmi2SetReal(c, vr, n, v); }
static int whole(instance c, const unsigned *vr, size_t n, int32_t *v) { return fmi2GetInteger(c, vr, n, v); }
static int step(instance c, double from, double length) { return fmi2DoStep(c, from, length, 1); }
static int save(instance c, void **state) { return fmi2GetFMUstate(c, state); }
static int restore(instance c, void *state) { return fmi2SetFMUstate(c, state); }
static int forget(instance c, void **state) { return fmi2FreeFMUstate(c, state); }
static int measure(instance c, void *state, size_t *size) { return fmi2SerializedFMUstateSize(c, state, size); }
static int serialise(instance c, void *state, void *bytes, size_t size) { return fmi2SerializeFMUstate(c, state, bytes, size); }
static int deserialise(instance c, const void *bytes, size_t size, void **state) {
  return fmi2DeSerializeFMUstate(c, bytes, size, state);
}
static int directional(instance c, const unsigned *of, size_t n, const unsigned *by, size_t m, const double *along, double *v) {
  return fmi2GetDirectionalDerivative(c, of, n, by, m, along, v);
}
static int event_mode(instance c) { return fmi2EnterEventMode(c); }
static int step_mode(instance c) { return fmi2EnterContinuousTimeMode(c); }
static int discrete(instance c) {
  fmi2EventInfo *info = room(sizeof *info);
  return fmi2NewDiscreteStates(c, info);
}
static int continuous(instance c) { return fmi2EnterContinuousTimeMode(c); }
static int completed(instance c) { return fmi2CompletedIntegratorStep(c, 1, room(sizeof(int)), room(sizeof(int))); }
static int set_time(instance c, double time) { return fmi2SetTime(c, time); }
static int array(instance c, int what, double *values, size_t n) {
  switch (what) {
    case GIVE_X: return fmi2SetContinuousStates(c, values, n);
    case TAKE_X: return fmi2GetContinuousStates(c, values, n);
    case TAKE_RATES: return fmi2GetDerivatives(c, values, n);
    case TAKE_GUARDS: return fmi2GetEventIndicators(c, values, n);
    default: return fmi2GetNominalsOfContinuousStates(c, values, n);
  }
}

static void everything_else(instance c, const unsigned *vr, size_t n, double *values) {
  static const char *const names[] = {"logAll", "logEvents", "logStatusError", "nonsense", 0};
  int *order = room(n * sizeof *order);
  for (size_t i = 0; i < n; i++) order[i] = (int)chance(3);
  const int one = 1;
  const double slope = chance(5) - 2.0;
  if (input && chance(2)) fmi2SetRealInputDerivatives(c, &input, 1, &one, &slope);
  muted = 1;
  fmi2SetDebugLogging(c, (int)chance(2), chance(3), chance(9) ? &names[chance(3)] : 0);
  fmi2SetRealInputDerivatives(c, vr, n, order, values), fmi2SetRealInputDerivatives(c, chance(2) ? 0 : vr, n, order, 0);
  fmi2GetRealOutputDerivatives(c, vr, n, order, values), fmi2GetRealOutputDerivatives(c, vr, n, 0, values);
  fmi2GetBoolean(c, vr, n, room(n * sizeof(int))), fmi2SetBoolean(c, vr, n, order), fmi2SetInteger(c, vr, n, order);
  fmi2GetString(c, vr, n, room(n * sizeof(fmi2String))), fmi2SetString(c, vr, n, 0), fmi2SetString(c, 0, n, 0);
  const fmi2StatusKind kind = (fmi2StatusKind)chance(4);
  fmi2CancelStep(c), fmi2GetStatus(c, kind, room(sizeof(fmi2Status))), fmi2GetStatus(c, kind, 0);
  fmi2GetRealStatus(c, kind, room(8)), fmi2GetRealStatus(c, kind, 0), fmi2GetIntegerStatus(c, kind, room(4));
  fmi2GetBooleanStatus(c, kind, room(4)), fmi2GetBooleanStatus(c, kind, 0);
  fmi2GetStringStatus(c, kind, room(sizeof(fmi2String))), fmi2GetStringStatus(c, kind, 0);
  fmi2NewDiscreteStates(c, 0), fmi2CompletedIntegratorStep(c, 1, 0, 0), fmi2SetContinuousStates(c, 0, n);
  fmi2GetContinuousStates(c, 0, states), fmi2GetEventIndicators(c, 0, indicators), fmi2GetDerivatives(c, 0, n);
}
