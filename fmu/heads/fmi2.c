/* FMI 2.0: the functions that Co-Simulation and Model Exchange share. */

#include "fmi2Functions.h"

typedef struct {
  fa_instance base;                  /* first, so that a component is also an instance */
  fmi2CallbackFunctions call;
} fa_fmi2;

static void fa_log_message(fa_instance *i, int status, const char *category, const char *line) {
  const fmi2CallbackFunctions *call = &((fa_fmi2 *)i)->call;
  if (call->logger) call->logger(call->componentEnvironment, i->name, (fmi2Status)status, category, line);
}

static void *fa_allocate_with(const fmi2CallbackFunctions *call, size_t size) {
  void *made = call->allocateMemory ? call->allocateMemory(1, size) : calloc(1, size);
  if (made) memset(made, 0, size);
  return made;
}

static void fa_free_with(const fmi2CallbackFunctions *call, void *made) {
  if (!call->allocateMemory) free(made);
  else if (call->freeMemory) call->freeMemory(made);
}

static void *fa_allocate(fa_instance *i, size_t size) { return fa_allocate_with(&((fa_fmi2 *)i)->call, size); }
static void fa_free(fa_instance *i, void *made) { fa_free_with(&((fa_fmi2 *)i)->call, made); }

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
  (void)resources; (void)visible;
  if (!functions) return 0;
  const char *wrong = fa_instantiation_error(name, guid);
  if (!wrong && type != fmi2CoSimulation && type != fmi2ModelExchange) wrong = "there is no such kind of FMU";
  fa_fmi2 *made = wrong ? 0 : fa_allocate_with(functions, sizeof *made);
  if (!made) {
    char line[300];
    fa_format_message(line, sizeof line, __func__, wrong ? wrong : "out of memory");
    if (functions->logger)
      functions->logger(functions->componentEnvironment, name ? name : "", fmi2Error, "logStatusError", line);
    return 0;
  }
  fa_instance *i = &made->base;
  made->call = *functions;
  i->alive = FA_ALIVE;
  i->exchange = type == fmi2ModelExchange;
  i->logging = logging ? -1 : 0;
  i->log_message = fa_log_message;
  i->allocate = fa_allocate;
  i->release = fa_free;
  snprintf(i->name, sizeof i->name, "%s", name);
  fa_reset_core(&i->core, i->exchange, 0, 0);
  return made;
}

void fmi2FreeInstance(fmi2Component c) {
  fa_instance *i = fa_as_instance(c);
  if (!i) return;
  const fmi2CallbackFunctions call = ((fa_fmi2 *)i)->call;
  i->alive = 0;
  fa_free_with(&call, i);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_set_debug_logging(i, __func__, on, n, categories);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean with_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean with_stop, fmi2Real stop) {
  FA_ALLOWED_IN(FA_BIT(FA_INSTANTIATED))
  return fa_setup_experiment(i, __func__, with_tolerance, tolerance, start, with_stop, stop);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  FA_ALLOWED_IN(FA_BIT(FA_INSTANTIATED))
  i->core.now.fmi_state = FA_INITIALIZATION_MODE;
  return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  FA_ALLOWED_IN(FA_BIT(FA_INITIALIZATION_MODE))
  return fa_leave_initialization(i, __func__);
}

fmi2Status fmi2Terminate(fmi2Component c) {
  FA_ALLOWED_IN(FA_BIT(FA_STEP_MODE) | FA_MODEL_EXCHANGE_MODES)
  return fa_enter_state(i, __func__, FA_TERMINATED);
}

fmi2Status fmi2Reset(fmi2Component c) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_reset(i);
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return n && !value ? fa_error(i, __func__, "value is NULL") : fa_get_values(i, __func__, vr, n, value, 0);
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_get_values(i, __func__, vr, n, 0, value);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
  FA_ALLOWED_IN(FA_SETTABLE)
  return fa_set_values(i, __func__, vr, n, value);
}

#define FA_UNSUPPORTED_TYPE(name, type)                                                                \
  fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[]) {     \
    (void)value;                                                                                \
    FA_ALLOWED_IN(FA_ANY_STATE)                                                                               \
    return fa_unsupported_variables(i, __func__, vr, n);                                                     \
  }

FA_UNSUPPORTED_TYPE(fmi2GetBoolean, fmi2Boolean)
FA_UNSUPPORTED_TYPE(fmi2GetString, fmi2String)
FA_UNSUPPORTED_TYPE(fmi2SetInteger, const fmi2Integer)
FA_UNSUPPORTED_TYPE(fmi2SetBoolean, const fmi2Boolean)
FA_UNSUPPORTED_TYPE(fmi2SetString, const fmi2String)

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                        const fmi2ValueReference known[], size_t knowns, const fmi2Real along[],
                                        fmi2Real result[]) {
  FA_ALLOWED_IN(FA_READABLE)
  return fa_get_directional_derivative(i, __func__, unknown, unknowns, known, knowns, along, result, 0);
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
  FA_ALLOWED_IN(FA_ANY_STATE & ~FA_BIT(FA_ERROR_STATE))
  return fa_get_fmu_state(i, __func__, state);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_set_fmu_state(i, __func__, state);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_free_fmu_state(i, state);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_serialized_fmu_state_size(i, __func__, state, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_serialize_fmu_state(i, __func__, state, bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_deserialize_fmu_state(i, __func__, bytes, size, state);
}
