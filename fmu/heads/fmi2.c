/* FMI 2.0: the functions that Co-Simulation and Model Exchange share. */

#include "fmi2Functions.h"

typedef struct {
  fa_instance base;                  /* first, so that a component is also an instance */
  fmi2CallbackFunctions call;
} fa_fmi2;

static void fa_report(fa_instance *i, int status, const char *category, const char *line) {
  const fmi2CallbackFunctions *call = &((fa_fmi2 *)i)->call;
  if (call->logger) call->logger(call->componentEnvironment, i->name, (fmi2Status)status, category, line);
}

static void *fa_allocate_by(const fmi2CallbackFunctions *call, size_t size) {
  void *made = call->allocateMemory ? call->allocateMemory(1, size) : calloc(1, size);
  if (made) memset(made, 0, size);
  return made;
}

static void fa_release_by(const fmi2CallbackFunctions *call, void *made) {
  if (!call->allocateMemory) free(made);
  else if (call->freeMemory) call->freeMemory(made);
}

static void *fa_allocate(fa_instance *i, size_t size) { return fa_allocate_by(&((fa_fmi2 *)i)->call, size); }
static void fa_release(fa_instance *i, void *made) { fa_release_by(&((fa_fmi2 *)i)->call, made); }

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
  (void)resources; (void)visible;
  if (!functions) return 0;
  const char *wrong = fa_no_instance(name, guid);
  if (!wrong && type != fmi2CoSimulation && type != fmi2ModelExchange) wrong = "there is no such kind of FMU";
  fa_fmi2 *made = wrong ? 0 : fa_allocate_by(functions, sizeof *made);
  if (!made) {
    char line[300];
    fa_line(line, sizeof line, __func__, wrong ? wrong : "out of memory");
    if (functions->logger)
      functions->logger(functions->componentEnvironment, name ? name : "", fmi2Error, "logStatusError", line);
    return 0;
  }
  fa_instance *i = &made->base;
  made->call = *functions;
  i->alive = FA_ALIVE;
  i->exchange = type == fmi2ModelExchange;
  i->logging = logging ? -1 : 0;
  i->report = fa_report;
  i->allocate = fa_allocate;
  i->release = fa_release;
  snprintf(i->name, sizeof i->name, "%s", name);
  fa_fresh(&i->core, i->exchange);
  return made;
}

void fmi2FreeInstance(fmi2Component c) {
  fa_instance *i = fa_of(c);
  if (!i) return;
  const fmi2CallbackFunctions call = ((fa_fmi2 *)i)->call;
  i->alive = 0;
  fa_release_by(&call, i);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
  FA_IN(FA_ANY)
  return fa_do_logging(i, __func__, on, n, categories);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean with_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean with_stop, fmi2Real stop) {
  (void)with_tolerance; (void)tolerance;
  FA_IN(FA_BIT(FA_INSTANTIATED))
  return fa_do_setup(i, __func__, start, with_stop, stop);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  FA_IN(FA_BIT(FA_INSTANTIATED))
  i->core.now.phase = FA_INITIALISING;
  return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  FA_IN(FA_BIT(FA_INITIALISING))
  return fa_do_phase(i, __func__, i->exchange ? FA_EVENT : FA_RUNNING);
}

fmi2Status fmi2Terminate(fmi2Component c) {
  FA_IN(FA_BIT(FA_RUNNING) | FA_EXCHANGING)
  return fa_do_phase(i, __func__, FA_TERMINATED);
}

fmi2Status fmi2Reset(fmi2Component c) {
  FA_IN(FA_ANY)
  return fa_do_reset(i);
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
  FA_IN(FA_ANY)
  return n && !value ? fa_no(i, __func__, "value is NULL") : fa_do_get(i, __func__, vr, n, value, 0);
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
  FA_IN(FA_ANY)
  return fa_do_get(i, __func__, vr, n, 0, value);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
  FA_IN(FA_SETTING)
  return fa_do_set(i, __func__, vr, n, value);
}

#define FA_NO_VALUES(name, type)                                                                \
  fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[]) {     \
    (void)value;                                                                                \
    FA_IN(FA_ANY)                                                                               \
    return fa_do_other(i, __func__, vr, n);                                                     \
  }

FA_NO_VALUES(fmi2GetBoolean, fmi2Boolean)
FA_NO_VALUES(fmi2GetString, fmi2String)
FA_NO_VALUES(fmi2SetInteger, const fmi2Integer)
FA_NO_VALUES(fmi2SetBoolean, const fmi2Boolean)
FA_NO_VALUES(fmi2SetString, const fmi2String)

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                        const fmi2ValueReference known[], size_t knowns, const fmi2Real along[],
                                        fmi2Real result[]) {
  FA_IN(FA_DEFINED)
  return fa_do_directional(i, __func__, unknown, unknowns, known, knowns, along, result, 0);
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
  FA_IN(FA_ANY & ~FA_BIT(FA_FAILED))
  return fa_do_save(i, __func__, state);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  FA_IN(FA_ANY)
  return fa_do_restore(i, __func__, state);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
  FA_IN(FA_ANY)
  return fa_do_forget(i, state);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
  FA_IN(FA_ANY)
  return fa_do_size(i, __func__, state, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
  FA_IN(FA_ANY)
  return fa_do_serialise(i, __func__, state, bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
  FA_IN(FA_ANY)
  return fa_do_deserialise(i, __func__, bytes, size, state);
}
