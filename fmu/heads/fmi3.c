/* FMI 3.0, Co-Simulation and Model Exchange. Functions for what this FMU has not, such as other types, are in
 * fmi3_refused.c. */

#include "fmi3Functions.h"

typedef struct {
  fa_instance base;                  /* first, so that an fmi3Instance is also an instance */
  fmi3InstanceEnvironment environment;
  fmi3LogMessageCallback log;
} fa_fmi3;

static void fa_log_message(fa_instance *i, int status, const char *category, const char *line) {
  const fa_fmi3 *own = (fa_fmi3 *)i;
  if (own->log) own->log(own->environment, (fmi3Status)status, category, line);
}

static void *fa_allocate(fa_instance *i, size_t size) {
  (void)i;
  return calloc(1, size);
}

static void fa_free(fa_instance *i, void *made) {
  (void)i;
  free(made);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

static fmi3Instance fa_instantiation_failed(fmi3LogMessageCallback log, fmi3InstanceEnvironment environment,
                                       const char *function, const char *why) {
  char line[300];
  fa_format_message(line, sizeof line, function, why);
  if (log) log(environment, fmi3Error, "logStatusError", line);
  return 0;
}

static fmi3Instance fa_instantiate(const char *function, const char *wrong, fmi3String name, fmi3String token,
                            fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                            int exchange, int hybrid, int early) {
  if (!wrong) wrong = fa_instantiation_error(name, token);
  fa_fmi3 *made = wrong ? 0 : calloc(1, sizeof *made);
  if (!made) return fa_instantiation_failed(log, environment, function, wrong ? wrong : "out of memory");
  fa_instance *i = &made->base;
  made->environment = environment;
  made->log = log;
  i->alive = FA_ALIVE;
  i->exchange = exchange;
  i->hybrid = hybrid;
  i->early = early;
  i->logging = logging ? -1 : 0;
  i->log_message = fa_log_message;
  i->allocate = fa_allocate;
  i->release = fa_free;
  snprintf(i->name, sizeof i->name, "%s", name);
  fa_reset_core(&i->core, exchange, hybrid, early);
  return made;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t n_intermediate,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
  (void)resources; (void)visible; (void)intermediate; (void)update;
  const char *wrong = n_intermediate ? "this FMU has no intermediate updates" : 0;
  const int hybrid = event_mode != 0;
  return fa_instantiate(__func__, wrong, name, token, logging, environment, log, 0, hybrid, hybrid && early_return);
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
  (void)resources; (void)visible;
  return fa_instantiate(__func__, 0, name, token, logging, environment, log, 1, 0, 0);
}

void fmi3FreeInstance(fmi3Instance c) {
  fa_instance *i = fa_as_instance(c);
  if (!i) return;
  i->alive = 0;
  free(i);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[]) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_set_debug_logging(i, __func__, on, n, categories);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean with_tolerance, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean with_stop, fmi3Float64 stop) {
  FA_ALLOWED_IN(FA_BIT(FA_INSTANTIATED))
  const int status = fa_setup_experiment(i, __func__, with_tolerance, tolerance, start, with_stop, stop);
  if (status == FA_STATUS_OK) i->core.now.fmi_state = FA_INITIALIZATION_MODE;
  return status;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
  FA_ALLOWED_IN(FA_BIT(FA_INITIALIZATION_MODE))
  return fa_leave_initialization(i, __func__);
}

fmi3Status fmi3Terminate(fmi3Instance c) {
  FA_ALLOWED_IN(FA_BIT(FA_STEP_MODE) | FA_MODEL_EXCHANGE_MODES)
  return fa_enter_state(i, __func__, FA_TERMINATED);
}

fmi3Status fmi3Reset(fmi3Instance c) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_reset(i);
}

/* References of elements, of which one call may name many. Without arrays they are those that were given. */
typedef struct {
  const unsigned *vr;
  size_t n;
  unsigned *made, own[64];
} fa_elements_of;

#ifdef FA_ARRAYS
/* Put the references of all elements in the place of those of arrays; each is to have one of `values` numbers. Elements
 * have references one after another, and only the first one's, which is the array's, may be given. */
static int fa_expand(fa_instance *i, const char *f, const unsigned *vr, size_t n, size_t values, fa_elements_of *all) {
  char text[200];
  size_t count = 0;
  all->vr = vr;
  all->n = n;
  all->made = 0;
  if (!n && !values) return FA_STATUS_OK;
  if (n && !vr) return fa_error(i, f, "the references are NULL");
  for (size_t k = 0; k < n; k++) {
    if (vr[k] < FA_VR_END && !fa_elements[vr[k]])
      return fa_invalid_reference(i, f, "an element of an array has no reference of its own", vr[k]);
    count += vr[k] < FA_VR_END ? (size_t)fa_elements[vr[k]] : 1;
  }
  if (count != values) {
    snprintf(text, sizeof text, "there must be a value for each element: %zu, not %zu", count, values);
    return fa_error(i, f, text);
  }
  unsigned *into = all->own;
  if (count > sizeof all->own / sizeof *all->own) into = all->made = malloc(count * sizeof *into);
  if (!into) return fa_error(i, f, "out of memory");
  all->vr = into;
  all->n = count;
  for (size_t k = 0; k < n; k++)
    for (unsigned j = 0; !j || (vr[k] < FA_VR_END && j < (unsigned)fa_elements[vr[k]]); j++) *into++ = vr[k] + j;
  return FA_STATUS_OK;
}
#else
static int fa_expand(fa_instance *i, const char *f, const unsigned *vr, size_t n, size_t values, fa_elements_of *all) {
  all->vr = vr;
  all->n = n;
  all->made = 0;
  return n == values ? FA_STATUS_OK
                     : fa_error(i, f, "there must be one value for each reference: all variables are scalar");
}
#endif

static int fa_check_count(fa_instance *i, const char *f, size_t n, size_t values) {
  return n == values ? FA_STATUS_OK
                     : fa_error(i, f, "there must be one value for each reference: these variables are scalar");
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[], size_t m) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  fa_elements_of all;
  if (fa_expand(i, __func__, vr, n, m, &all)) return fmi3Error;
  const int status = m && !values ? fa_error(i, __func__, "values is NULL")
                                  : fa_get_values(i, __func__, all.vr, all.n, values, 0);
  free(all.made);
  return status;
}

fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Int32 values[], size_t m) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_check_count(i, __func__, n, m) ? fmi3Error : fa_get_values(i, __func__, vr, n, 0, values);
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[],
                          size_t m) {
  FA_ALLOWED_IN(FA_SETTABLE)
  fa_elements_of all;
  if (fa_expand(i, __func__, vr, n, m, &all)) return fmi3Error;
  const int status = fa_set_values(i, __func__, all.vr, all.n, values);
  free(all.made);
  return status;
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) {
  FA_ALLOWED_IN(FA_ANY_STATE & ~FA_BIT(FA_ERROR_STATE))
  return fa_get_fmu_state(i, __func__, state);
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_set_fmu_state(i, __func__, state);
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_free_fmu_state(i, state);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_serialized_fmu_state_size(i, __func__, state, size);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_serialize_fmu_state(i, __func__, state, bytes, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_deserialize_fmu_state(i, __func__, bytes, size, state);
}

static int fa_product_with_jacobian(fa_instance *i, const char *f, const unsigned *unknowns, size_t n_unknowns,
                                    size_t of_unknowns, const unsigned *knowns, size_t n_knowns, size_t of_knowns,
                                    const double *seed, double *sensitivity, int adjoint) {
  fa_elements_of rows, columns;
  if (fa_expand(i, f, unknowns, n_unknowns, of_unknowns, &rows)) return FA_STATUS_ERROR;
  int status = fa_expand(i, f, knowns, n_knowns, of_knowns, &columns);
  if (!status) {
    status = fa_get_directional_derivative(i, f, rows.vr, rows.n, columns.vr, columns.n, seed, sensitivity, adjoint);
    free(columns.made);
  }
  free(rows.made);
  return status;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
  FA_ALLOWED_IN(FA_READABLE)
  return fa_product_with_jacobian(i, __func__, unknowns, n_unknowns, n_sensitivity, knowns, n_knowns, n_seed, seed,
                                  sensitivity, 0);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
  FA_ALLOWED_IN(FA_READABLE)
  return fa_product_with_jacobian(i, __func__, unknowns, n_unknowns, n_seed, knowns, n_knowns, n_sensitivity, seed,
                                  sensitivity, 1);
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Int32 orders[],
                                    fmi3Float64 values[], size_t m) {
  FA_ALLOWED_IN(FA_BIT(FA_STEP_MODE) | FA_BIT(FA_TERMINATED))
  return fa_check_count(i, __func__, n, m) ? fmi3Error : fa_get_output_derivatives(i, __func__, vr, n, orders, values);
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  if (!n) return fa_error(i, __func__, "the count is NULL");
  *n = FA_NX;
  return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  if (!n) return fa_error(i, __func__, "the count is NULL");
  *n = FA_NG;
  return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 now, fmi3Float64 length, fmi3Boolean no_return, fmi3Boolean *event,
                      fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last) {
  (void)no_return;
  FA_ALLOWED_IN(FA_BIT(FA_STEP_MODE))
  const int status = fa_do_step(i, __func__, now, length), waits = !status && fa_event_waits(&i->core.now);
  if (event) *event = waits;
  if (end) *end = fmi3False;
  if (early) *early = waits && fa_time(i) < now + length - fa_time_tolerance(now);
  if (last) *last = fa_time(i);
  return status;
}

/* -- events ----------------------------------------------------------------------------------------------------- */

fmi3Status fmi3EnterEventMode(fmi3Instance c) {
  FA_ALLOWED_IN(FA_MODEL_EXCHANGE_MODES | FA_BIT(FA_STEP_MODE))
  return fa_enter_event_mode(i, __func__);
}

fmi3Status fmi3EnterStepMode(fmi3Instance c) {
  FA_ALLOWED_IN(FA_BIT(FA_EVENT_MODE))
  return fa_enter_step_mode(i, __func__);
}

/* Clocks tick by themselves; which of them tick at an event is known in event mode, until it is processed. */
fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Clock values[]) {
  FA_ALLOWED_IN(FA_BIT(FA_EVENT_MODE))
  unsigned char ticks;
  if (n && !values) return fa_error(i, __func__, "values is NULL");
  for (size_t k = 0; k < n; k++) {
    if (fa_get_clocks(i, __func__, vr ? vr + k : 0, 1, &ticks)) return fmi3Error;
    values[k] = ticks != 0;
  }
  return fmi3OK;
}

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Clock values[]) {
  (void)values;
  FA_ALLOWED_IN(FA_ANY_STATE)
  if (!n) return fmi3OK;
  return vr ? fa_invalid_reference(i, __func__, "clocks tick by themselves and cannot be set", vr[0])
            : fa_error(i, __func__, "the references are NULL");
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *end, fmi3Boolean *nominals,
                                    fmi3Boolean *values, fmi3Boolean *timed, fmi3Float64 *time) {
  FA_ALLOWED_IN(FA_BIT(FA_EVENT_MODE))
  int moved = 0;
  double next = 0;
  if (!again || !end || !nominals || !values || !timed || !time) return fa_error(i, __func__, "an argument is NULL");
  const int status = fa_update_discrete_states(i, __func__, &moved, &next);
  if (status) return status;
  *again = *end = *nominals = fmi3False;
  *values = moved != 0;
  *timed = next < HUGE_VAL;
  *time = next < HUGE_VAL ? next : 0;
  return fmi3OK;
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c) {
  FA_ALLOWED_IN(FA_BIT(FA_INITIALIZATION_MODE) | FA_BIT(FA_EVENT_MODE))
  return fa_evaluated(i, __func__);
}

/* -- Model Exchange --------------------------------------------------------------------------------------------- */

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) {
  FA_ALLOWED_IN(FA_BIT(FA_EVENT_MODE))
  return fa_enter_continuous_time_mode(i, __func__);
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean final, fmi3Boolean *event, fmi3Boolean *end) {
  (void)final;
  FA_ALLOWED_IN(FA_BIT(FA_CONTINUOUS_TIME_MODE))
  if (!event || !end) return fa_error(i, __func__, "an argument is NULL");
  *event = *end = fmi3False;
  return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time) {
  FA_ALLOWED_IN(FA_MODEL_EXCHANGE_MODES)
  return fa_set_time(i, __func__, time);
}

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n) {
  FA_ALLOWED_IN(FA_BIT(FA_CONTINUOUS_TIME_MODE))
  return fa_get_or_set_array(i, __func__, FA_SET_STATES, 0, x, n);
}

#define FA_GET_ARRAY(name, what)                                         \
  fmi3Status name(fmi3Instance c, fmi3Float64 values[], size_t n) {  \
    FA_ALLOWED_IN(FA_ANY_MODE | FA_BIT(FA_TERMINATED))                        \
    return fa_get_or_set_array(i, __func__, what, values, 0, n);             \
  }

FA_GET_ARRAY(fmi3GetContinuousStateDerivatives, FA_GET_DERIVATIVES)
FA_GET_ARRAY(fmi3GetEventIndicators, FA_GET_EVENT_INDICATORS)
FA_GET_ARRAY(fmi3GetContinuousStates, FA_GET_STATES)
FA_GET_ARRAY(fmi3GetNominalsOfContinuousStates, FA_GET_NOMINALS)
