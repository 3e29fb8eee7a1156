/* FMI 3 for sanitized.c. */

#include "fmi3Functions.h"

typedef fmi3Instance instance;

static void logger(fmi3InstanceEnvironment e, fmi3Status status, fmi3String category, fmi3String text) {
  (void)e;
  must(category && status >= fmi3OK && status <= fmi3Fatal);
  said(text);
}

static instance make(const char *name, const char *token, int kind, int logging) {
  const int events = kind >= EVENTS;
  return kind == EXCHANGE ? fmi3InstantiateModelExchange(name, token, 0, 0, logging, 0, logger)
                          : fmi3InstantiateCoSimulation(name, token, 0, 0, logging, events, kind == EARLY, 0, 0, 0, logger, 0);
}

static void everything_else(instance c, const unsigned *vr, size_t n, double *values);

static void no_more_instances(void) {
  const unsigned vr = 0;
  must(!fmi3InstantiateCoSimulation("x", guid, 0, 0, 1, 0, 0, &vr, 1, 0, logger, 0));
  must(!fmi3InstantiateScheduledExecution("x", guid, 0, 0, 1, 0, logger, 0, 0, 0));
  must(!fmi3InstantiateCoSimulation(0, guid, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0));
  instance c = fmi3InstantiateCoSimulation("x", guid, "nowhere", 1, 1, 0, 1, 0, 0, 0, 0, 0);
  must(c && fmi3DoStep(c, 0, 1, 0, 0, 0, 0, 0) == fmi3Error);
  fmi3FreeInstance(c);
  must(!strcmp(fmi3GetVersion(), "3.0"));
  double value = 0;
  everything_else(0, &vr, 1, &value);
  tidy();
}

static void release(instance c) { fmi3FreeInstance(c); }
static int enter(instance c, double start, int with_stop, double stop) {
  return fmi3EnterInitializationMode(c, 1, 1e-6, start, with_stop, stop);
}
static int leave(instance c) { return fmi3ExitInitializationMode(c); }
static int end(instance c) { return fmi3Terminate(c); }
static int reset(instance c) { return fmi3Reset(c); }
static int get(instance c, const unsigned *vr, size_t n, double *v) { return fmi3GetFloat64(c, vr, n, v, n); }
static int set(instance c, const unsigned *vr, size_t n, const double *v) { return fmi3SetFloat64(c, vr, n, v, n); }
static int whole(instance c, const unsigned *vr, size_t n, int32_t *v) { return fmi3GetInt32(c, vr, n, v, n); }
static int step(instance c, double from, double length) {
  fmi3Boolean *flags = room(3 * sizeof *flags);
  return fmi3DoStep(c, from, length, 1, &flags[0], &flags[1], &flags[2], room(8));
}
static int save(instance c, void **state) { return fmi3GetFMUState(c, state); }
static int restore(instance c, void *state) { return fmi3SetFMUState(c, state); }
static int forget(instance c, void **state) { return fmi3FreeFMUState(c, state); }
static int measure(instance c, void *state, size_t *size) { return fmi3SerializedFMUStateSize(c, state, size); }
static int serialise(instance c, void *state, void *bytes, size_t size) { return fmi3SerializeFMUState(c, state, bytes, size); }
static int deserialise(instance c, const void *bytes, size_t size, void **state) {
  return fmi3DeserializeFMUState(c, bytes, size, state);
}
static int directional(instance c, const unsigned *of, size_t n, const unsigned *by, size_t m, const double *along, double *v) {
  return fmi3GetDirectionalDerivative(c, of, n, by, m, along, m, v, n);
}
static int event_mode(instance c) { return fmi3EnterEventMode(c); }
static int step_mode(instance c) { return fmi3EnterStepMode(c); }
static int discrete(instance c) {
  fmi3Boolean *flags = room(5 * sizeof *flags);
  return fmi3UpdateDiscreteStates(c, &flags[0], &flags[1], &flags[2], &flags[3], &flags[4], room(8));
}
static int continuous(instance c) { return fmi3EnterContinuousTimeMode(c); }
static int completed(instance c) {
  return fmi3CompletedIntegratorStep(c, 1, room(sizeof(fmi3Boolean)), room(sizeof(fmi3Boolean)));
}
static int set_time(instance c, double time) { return fmi3SetTime(c, time); }
static int array(instance c, int what, double *values, size_t n) {
  switch (what) {
    case GIVE_X: return fmi3SetContinuousStates(c, values, n);
    case TAKE_X: return fmi3GetContinuousStates(c, values, n);
    case TAKE_RATES: return fmi3GetContinuousStateDerivatives(c, values, n);
    case TAKE_GUARDS: return fmi3GetEventIndicators(c, values, n);
    default: return fmi3GetNominalsOfContinuousStates(c, values, n);
  }
}

#define OTHER(name, type) \
  fmi3Get##name(c, vr, n, room(n * sizeof(type)), n), fmi3Set##name(c, vr, n, room(n * sizeof(type)), n); \
  fmi3Get##name(c, 0, n, 0, n), fmi3Set##name(c, 0, n, 0, n);

static void everything_else(instance c, const unsigned *vr, size_t n, double *values) {
  static const char *const names[] = {"logAll", "logEvents", "logStatusError", "nonsense", 0};
  int32_t *order = room(n * sizeof *order);
  for (size_t i = 0; i < n; i++) order[i] = (int32_t)chance(3);
  muted = 1;
  fmi3SetDebugLogging(c, chance(2), chance(3), chance(9) ? &names[chance(3)] : 0);
  fmi3GetOutputDerivatives(c, vr, n, order, values, n), fmi3GetOutputDerivatives(c, vr, n, 0, values, n + 1);
  const size_t m = chance(4);
  fmi3GetAdjointDerivative(c, vr, n, some_references(m), m, values, n, some_values(m), m);
  fmi3GetAdjointDerivative(c, 0, n, some_references(m), m, 0, n, 0, m);
  fmi3GetFloat64(c, vr, n, values, n + 1), fmi3SetFloat64(c, vr, n, values, n + 1), fmi3SetInt32(c, vr, n, order, n);
  fmi3GetInt32(c, vr, n, order, n + 1);
  OTHER(Float32, float) OTHER(Int8, int8_t) OTHER(UInt8, uint8_t) OTHER(Int16, int16_t) OTHER(UInt16, uint16_t)
  OTHER(UInt32, uint32_t) OTHER(Int64, int64_t) OTHER(UInt64, uint64_t) OTHER(Boolean, fmi3Boolean)
  OTHER(String, fmi3String)
  size_t *sizes = room(n * sizeof *sizes), count = 0;
  memset(sizes, 0, n * sizeof *sizes);
  fmi3GetBinary(c, vr, n, sizes, room(n * sizeof(fmi3Binary)), n), fmi3SetBinary(c, vr, n, sizes, 0, n);
  fmi3GetClock(c, vr, n, room(n * sizeof(fmi3Clock))), fmi3SetClock(c, vr, n, 0);
  fmi3GetNumberOfVariableDependencies(c, n ? vr[0] : 0, &count), fmi3GetNumberOfVariableDependencies(c, 0, 0);
  fmi3GetVariableDependencies(c, 0, 0, 0, 0, 0, 0);
  fmi3EnterConfigurationMode(c), fmi3ExitConfigurationMode(c), fmi3EnterStepMode(c), fmi3EvaluateDiscreteStates(c);
  fmi3ActivateModelPartition(c, n ? vr[0] : 0, values ? 0 : 1);
  fmi3IntervalQualifier *qualifier = room(n * sizeof *qualifier);
  uint64_t *counter = room(n * sizeof *counter), *resolution = room(n * sizeof *resolution);
  memset(counter, 0, n * sizeof *counter), memset(resolution, 0, n * sizeof *resolution);
  fmi3GetIntervalDecimal(c, vr, n, values, qualifier), fmi3SetIntervalDecimal(c, vr, n, values);
  fmi3GetIntervalFraction(c, vr, n, counter, resolution, qualifier), fmi3SetIntervalFraction(c, vr, n, counter, resolution);
  fmi3GetShiftDecimal(c, vr, n, values), fmi3SetShiftDecimal(c, vr, n, values);
  fmi3GetShiftFraction(c, vr, n, counter, resolution), fmi3SetShiftFraction(c, vr, n, counter, resolution);
  fmi3GetNumberOfContinuousStates(c, &count);
  must(!c || count == states);
  fmi3GetNumberOfEventIndicators(c, &count);
  must(!c || count == indicators);
  fmi3GetNumberOfContinuousStates(c, 0), fmi3GetNumberOfEventIndicators(c, 0);
  fmi3UpdateDiscreteStates(c, 0, 0, 0, 0, 0, 0), fmi3CompletedIntegratorStep(c, 1, 0, 0);
  fmi3SetContinuousStates(c, 0, n), fmi3GetContinuousStates(c, 0, states), fmi3GetEventIndicators(c, 0, indicators);
}
