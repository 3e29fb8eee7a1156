/* What an FMI head does with its arguments, whatever the version: the two heads only spell it differently. Statuses are
 * those that FMI 2 and FMI 3 share.
 *
 * A call that cannot be obeyed changes nothing, logs why and returns an error, or "discard" for a value out of range;
 * the instance then stays usable. Only a failed step or evaluation fails the instance, until it is reset or given an
 * earlier state. */

#define FA_STATUS_OK 0
#define FA_STATUS_WARNING 1
#define FA_STATUS_DISCARD 2
#define FA_STATUS_ERROR 3

typedef struct fa_instance {
  int64_t alive;
  fa_core core;
  int exchange;                      /* Model Exchange */
  int hybrid, early;                 /* Co-Simulation with event mode; whether its steps may return early */
  int logging, last;                 /* a bit for each category; status of the last step */
  void (*log_message)(struct fa_instance *, int status, const char *category, const char *line);
  void *(*allocate)(struct fa_instance *, size_t size);
  void (*release)(struct fa_instance *, void *made);
  char name[256];
} fa_instance;

#define FA_ALIVE INT64_C(0x6d7261786c666d66)
#define FA_LOG_CATEGORIES 5
static const char *const fa_log_category[] = {"logAll", "logEvents", "logStatusWarning", "logStatusDiscard",
                                              "logStatusError"};
static const char *const fa_fmi_state_name[] = {"instantiated", "in initialization mode", "in step mode", "terminated",
                                                "in error", "in event mode", "in continuous-time mode"};

/* Loggers may take the text for a format, and FMI gives # a meaning, so % and # are taken out. */
static void fa_format_message(char *line, size_t size, const char *function, const char *text) {
  snprintf(line, size, "%s: %s", function, text);
  for (char *at = line; *at; at++)
    if (*at == '%' || *at == '#') *at = '_';
}

enum { FA_LOG_EVENTS = 1, FA_LOG_WARNING, FA_LOG_DISCARD, FA_LOG_ERROR };

static int fa_logs(const fa_instance *i, int category) { return i->logging & (1 << category); }

static void fa_say(fa_instance *i, int status, int category, const char *function, const char *text) {
  char line[700];
  if (!fa_logs(i, category)) return;
  fa_format_message(line, sizeof line, function, text);
  i->log_message(i, status, fa_log_category[category], line);
}

static int fa_log_status(fa_instance *i, int status, const char *function, const char *text) {
  fa_say(i, status, status == FA_STATUS_DISCARD ? FA_LOG_DISCARD : FA_LOG_ERROR, function, text);
  return status;
}

static int fa_error(fa_instance *i, const char *function, const char *text) {
  return fa_log_status(i, FA_STATUS_ERROR, function, text);
}

static int fa_simulation_error(fa_instance *i, const char *function) {
  return fa_error(i, function, fa_simulation_message(&i->core));
}

/* Parameters that contradict one another are an error of this call; the instance stays as it is, and usable. */
static int fa_refuse_conflict(fa_instance *i, const char *function) {
  const char *why = fa_parameter_conflict(&i->core);
  return why ? fa_error(i, function, why) : FA_STATUS_OK;
}

/* See that the present instant has values. */
static int fa_evaluated(fa_instance *i, const char *function) {
  if (fa_refuse_conflict(i, function)) return FA_STATUS_ERROR;
  return fa_ensure_evaluated(&i->core) ? fa_simulation_error(i, function) : FA_STATUS_OK;
}

static int fa_invalid_reference(fa_instance *i, const char *function, const char *what, unsigned vr) {
  char text[300];
  snprintf(text, sizeof text, "%s: value reference %u%s%s", what, vr, vr < FA_VR_END ? ", " : "",
           vr < FA_VR_END ? fa_name[vr] : "");
  return fa_error(i, function, text);
}

static fa_instance *fa_as_instance(void *c) {
  fa_instance *i = (fa_instance *)c;
  return i && i->alive == FA_ALIVE ? i : 0;
}

#define FA_BIT(fmi_state) (1 << (fmi_state))
#define FA_MODEL_EXCHANGE_MODES (FA_BIT(FA_EVENT_MODE) | FA_BIT(FA_CONTINUOUS_TIME_MODE))
#define FA_ANY_MODE (FA_BIT(FA_INITIALIZATION_MODE) | FA_BIT(FA_STEP_MODE) | FA_MODEL_EXCHANGE_MODES)
#define FA_SETTABLE (FA_BIT(FA_INSTANTIATED) | FA_ANY_MODE)
#define FA_READABLE (FA_ANY_MODE | FA_BIT(FA_TERMINATED))
#define FA_ANY_STATE (FA_SETTABLE | FA_BIT(FA_TERMINATED) | FA_BIT(FA_ERROR_STATE))

/* The instance, if it is one and in one of the allowed FMI states; else NULL, logged. */
static fa_instance *fa_instance_allowed_in(void *c, int allowed, const char *function) {
  fa_instance *i = fa_as_instance(c);
  if (!i || (FA_BIT(i->core.now.fmi_state) & allowed)) return i;
  char text[100];
  snprintf(text, sizeof text, "not allowed while the instance is %s", fa_fmi_state_name[i->core.now.fmi_state]);
  fa_error(i, function, text);
  return 0;
}

#define FA_ALLOWED_IN(allowed)                                       \
  fa_instance *i = fa_instance_allowed_in(c, (allowed), __func__);  \
  if (!i) return FA_STATUS_ERROR;

/* Why no instance can be made, or NULL. */
static const char *fa_instantiation_error(const char *name, const char *token) {
  if (!name || !*name) return "the instance name is missing";
  if (!token || strcmp(token, FA_GUID))
    return "the GUID or token is not that of modelDescription.xml; is the binary from another export?";
  return 0;
}

/* -- events and warnings ---------------------------------------------------------------------------------------- */

#define FA_LOGGED 64                                           /* switches that one call can tell of */

/* Listen to the switches of a call into `row`, if they are logged. */
static void fa_listen(fa_instance *i, double *row) {
  fa_sim *s = &i->core.now.sim;
  s->log = fa_logs(i, FA_LOG_EVENTS) ? row : 0;
  s->log_length = 0;
  s->log_capacity = FA_LOGGED;
}

static void fa_tell(fa_instance *i, const char *f) {
  fa_sim *s = &i->core.now.sim;
  char text[400];
  for (int64_t k = 0; s->log && k < s->log_length; k++) {
    const double *row = s->log + 3 * k;
    const int mode = (int)row[1];
    if (mode < FA_NF + FA_NS)
      snprintf(text, sizeof text, "at %.9g s '%s' becomes %s", row[0], fa_mode_name[mode],
               fa_mode_label[3 * mode + 1 + (int)row[2]]);
    else snprintf(text, sizeof text, "at %.9g s time event %.0f of '%s'", row[0], row[2], fa_mode_name[mode]);
    fa_say(i, FA_STATUS_OK, FA_LOG_EVENTS, f, text);
  }
  s->log = 0;
  s->log_length = s->log_capacity = 0;
}

/* The internal step is chosen at the start; say so if the parameters now would need a finer one. */
static void fa_warn_of_step(fa_instance *i, const char *f) {
#ifdef FA_ADAPTIVE
  (void)i; (void)f;
#else
  char text[300];
  fa_state *s = &i->core.now;
  if (i->exchange || !fa_logs(i, FA_LOG_WARNING) || !(s->pending & FA_PENDING_PARAMETERS) || (s->pending & FA_PENDING_START)) return;
  fa_sim trial = s->sim;
  memcpy(trial.p, s->p, sizeof(double) * FA_NP);
  fa_prepare_parameters(trial.p, trial.cp);
  const double wanted = fa_choose_step(&trial);
  if (wanted >= 0.99 * s->sim.hmax) return;
  snprintf(text, sizeof text, "the parameters now need an internal step of %.3g s; that of this run, chosen at its "
           "start, stays %.3g s: results may be inaccurate or diverge; set them before initialization ends", wanted,
           s->sim.hmax);
  fa_say(i, FA_STATUS_WARNING, FA_LOG_WARNING, f, text);
#endif
}

/* -- life ------------------------------------------------------------------------------------------------------- */

static int fa_set_debug_logging(fa_instance *i, const char *f, int on, size_t n, const char *const *categories) {
  int chosen = n ? 0 : -1;
  if (n && !categories) return fa_error(i, f, "categories is NULL");
  for (size_t k = 0; k < n; k++) {
    int found = 0;
    for (int j = 0; j < FA_LOG_CATEGORIES; j++)
      if (categories[k] && !strcmp(categories[k], fa_log_category[j])) found = j ? 1 << j : -1;
    if (!found) return fa_error(i, f, "unknown log category");
    chosen |= found;
  }
  i->logging = on ? i->logging | chosen : i->logging & ~chosen;
  return FA_STATUS_OK;
}

static int fa_setup_experiment(fa_instance *i, const char *f, int with_tolerance, double tolerance, double start,
                               int with_stop, double stop) {
  fa_state *s = &i->core.now;
  if (with_tolerance && !(tolerance >= 0 && tolerance <= 1)) return fa_error(i, f, "the tolerance lies outside 0 to 1");
  if (!(start - start == 0) || start + FA_STEP == start)
    return fa_error(i, f, "startTime is not finite, or so large that a step is lost in rounding");
  if (with_stop && !(stop >= start)) return fa_error(i, f, "stopTime lies before startTime");
  s->start = start;
  s->tolerance = with_tolerance ? tolerance : 0;
  s->stop_defined = with_stop != 0;
  s->stop = with_stop ? stop : 0;
  return FA_STATUS_OK;
}

/* Enter an FMI state in which the present instant must have values. */
static int fa_enter_state(fa_instance *i, const char *f, int fmi_state) {
  fa_core *c = &i->core;
  if (fa_refuse_conflict(i, f)) return FA_STATUS_ERROR;
  if (fa_ensure_evaluated(c)) {
    c->now.fmi_state = FA_ERROR_STATE;
    return fa_simulation_error(i, f);
  }
  c->now.fmi_state = c->before.fmi_state = fmi_state;
  return FA_STATUS_OK;
}

static int fa_leave_initialization(fa_instance *i, const char *f) {
  fa_core *c = &i->core;
  const int status = fa_enter_state(i, f, i->exchange || i->hybrid ? FA_EVENT_MODE : FA_STEP_MODE);
  if (status || !(i->exchange || i->hybrid)) return status;
  double fire[FA_SIZE(FA_NC)];
  fa_due_clocks(0, fire);
  for (int k = 0; k < FA_NC; k++) c->now.ticking[k] = c->before.ticking[k] = fire[k] != 0;
  return status;
}

static int fa_reset(fa_instance *i) {
  fa_reset_core(&i->core, i->exchange, i->hybrid, i->early);
  i->last = FA_STATUS_OK;
  return FA_STATUS_OK;
}

/* -- values ----------------------------------------------------------------------------------------------------- */

/* Reals, or modes as whole numbers. */
static int fa_get_values(fa_instance *i, const char *f, const unsigned *vr, size_t n, double *real, int32_t *whole) {
  fa_core *c = &i->core;
  int given = 1;
  if (!n) return FA_STATUS_OK;
  if (!vr || !(real || whole)) return fa_error(i, f, "the references or values are NULL");
  for (size_t k = 0; k < n; k++) {
    const int is_mode = vr[k] >= FA_VR_M && vr[k] < FA_VR_G;
    if (vr[k] >= FA_VR_C || is_mode == (real != 0))
      return fa_invalid_reference(i, f, "no variable of this type", vr[k]);
    given &= fa_is_given(&c->now, vr[k]);
  }
  if (!given) {
    if (!(FA_BIT(c->now.fmi_state) & FA_READABLE))
      return fa_error(i, f, "outputs and states have no value before initialization or after an error");
    if (fa_evaluated(i, f)) return FA_STATUS_ERROR;
  }
  for (size_t k = 0; k < n; k++) {
    if (real) real[k] = fa_get_value(c, vr[k]);
    else whole[k] = (int32_t)fa_get_value(c, vr[k]);
  }
  return FA_STATUS_OK;
}

static int fa_set_values(fa_instance *i, const char *f, const unsigned *vr, size_t n, const double *value) {
  fa_core *c = &i->core;
  if (n && (!vr || !value)) return fa_error(i, f, "the references or values are NULL");
  for (size_t k = 0; k < n; k++) {
    if (vr[k] >= FA_VR_END || (!fa_is_parameter(vr[k]) && !fa_is_input(vr[k]) && !fa_is_start(vr[k])))
      return fa_invalid_reference(i, f, "neither an input nor a parameter, nor the start of a state", vr[k]);
    if (c->now.fmi_state > FA_INITIALIZATION_MODE && fa_is_start(vr[k]))
      return fa_invalid_reference(i, f, "the start of a state cannot change after initialization", vr[k]);
    if (c->now.fmi_state > FA_INITIALIZATION_MODE && fa_is_parameter(vr[k]) &&
        !(fa_p_kind[vr[k] - FA_VR_P] & FA_TUNABLE))
      return fa_invalid_reference(i, f, "a fixed parameter cannot change after initialization", vr[k]);
    if (c->now.fmi_state == FA_CONTINUOUS_TIME_MODE && fa_is_parameter(vr[k]))
      return fa_invalid_reference(i, f, "parameters change in event mode", vr[k]);
    const char *why = fa_value_error(c, vr[k], value[k]);
    if (why) return fa_log_status(i, FA_STATUS_DISCARD, f, why);
  }
  for (size_t k = 0; k < n; k++) fa_set_value(c, vr[k], value[k]);
  return FA_STATUS_OK;
}

static int fa_unsupported_variables(fa_instance *i, const char *f, const unsigned *vr, size_t n) {
  if (!n) return FA_STATUS_OK;
  return vr ? fa_invalid_reference(i, f, "no variable of this type can be used so", vr[0])
            : fa_error(i, f, "the references are NULL");
}

static int fa_set_input_derivatives(fa_instance *i, const char *f, const unsigned *vr, size_t n, const int32_t *order,
                        const double *value) {
  fa_core *c = &i->core;
  if (n && (!vr || !order || !value)) return fa_error(i, f, "the references, orders or values are NULL");
  if (i->exchange) return fa_error(i, f, "not for Model Exchange");
  for (size_t k = 0; k < n; k++) {
    if (!fa_is_input(vr[k])) return fa_invalid_reference(i, f, "not an input", vr[k]);
    if (order[k] != 1) return fa_error(i, f, "only derivatives of order 1 are used");
    const char *why = fa_value_error(c, vr[k], value[k]);
    if (why) return fa_log_status(i, FA_STATUS_DISCARD, f, why);
  }
  for (size_t k = 0; k < n; k++) fa_set_input_derivative(c, vr[k], value[k]);
  return FA_STATUS_OK;
}

static int fa_get_output_derivatives(fa_instance *i, const char *f, const unsigned *vr, size_t n, const int32_t *order,
                       double *value) {
  double rate[FA_SIZE(FA_NY)];
  if (n && (!vr || !order || !value)) return fa_error(i, f, "the references, orders or values are NULL");
  for (size_t k = 0; k < n; k++) {
    if (vr[k] < FA_VR_Y || vr[k] >= FA_VR_X) return fa_invalid_reference(i, f, "not an output", vr[k]);
    if (order[k] != 1) return fa_error(i, f, "only derivatives of order 1 are known");
  }
  if (!n) return FA_STATUS_OK;
  if (fa_evaluated(i, f)) return FA_STATUS_ERROR;
  fa_output_derivatives(&i->core, rate);
  for (size_t k = 0; k < n; k++) value[k] = rate[vr[k] - FA_VR_Y];
  return FA_STATUS_OK;
}

/* J seed, or with adjoint J' seed, for the block J of the unknowns by the knowns. */
static int fa_get_directional_derivative(fa_instance *i, const char *f, const unsigned *unknown, size_t unknowns,
                             const unsigned *known, size_t knowns, const double *along, double *result, int adjoint) {
  double seed[FA_SIZE(1 + FA_NX + FA_NI)], rate[FA_SIZE(FA_NX + FA_NY + FA_NG)];
  memset(seed, 0, sizeof seed);
  if ((unknowns && (!unknown || !(adjoint ? along : result))) || (knowns && (!known || !(adjoint ? result : along))))
    return fa_error(i, f, "an argument is NULL");
  for (size_t k = 0; k < unknowns; k++)
    if (fa_unknown_index(unknown[k]) < 0)
      return fa_invalid_reference(i, f, "only outputs, state derivatives and indicators are unknowns", unknown[k]);
  for (size_t k = 0; k < knowns; k++)
    if (fa_known_index(known[k]) < 0) return fa_invalid_reference(i, f, "only inputs and states are knowns", known[k]);
  for (size_t k = 0; k < (adjoint ? unknowns : knowns); k++)
    if (!(along[k] - along[k] == 0)) return fa_log_status(i, FA_STATUS_DISCARD, f, "a seed is not finite");
  if (fa_evaluated(i, f)) return FA_STATUS_ERROR;
  if (adjoint) {
    for (size_t k = 0; k < knowns; k++) {
      seed[fa_known_index(known[k])] = 1;
      fa_shown_derivative(&i->core, seed, rate);
      seed[fa_known_index(known[k])] = result[k] = 0;
      for (size_t j = 0; j < unknowns; j++) result[k] += along[j] * rate[fa_unknown_index(unknown[j])];
    }
    return FA_STATUS_OK;
  }
  for (size_t k = 0; k < knowns; k++) seed[fa_known_index(known[k])] += along[k];
  fa_shown_derivative(&i->core, seed, rate);
  for (size_t k = 0; k < unknowns; k++) result[k] = rate[fa_unknown_index(unknown[k])];
  return FA_STATUS_OK;
}

/* -- saved states ----------------------------------------------------------------------------------------------- */

static int fa_get_fmu_state(fa_instance *i, const char *f, void **state) {
  if (!state) return fa_error(i, f, "the state is NULL");
  fa_fmu_state *saved = *state ? *state : i->allocate(i, sizeof *saved);
  if (!saved) return fa_error(i, f, "out of memory");
  fa_save(&i->core, saved);
  *state = saved;
  return FA_STATUS_OK;
}

static int fa_set_fmu_state(fa_instance *i, const char *f, const void *state) {
  const char *why = state ? fa_fmu_state_error(state) : "the state is NULL";
  if (why) return fa_error(i, f, why);
  if (((const fa_fmu_state *)state)->state.exchange != i->exchange)
    return fa_error(i, f, "it is a state of the other kind: Co-Simulation and Model Exchange do not mix");
  if (((const fa_fmu_state *)state)->state.hybrid != i->hybrid)
    return fa_error(i, f, "it is a state of the other kind: Co-Simulation with and without event mode do not mix");
  fa_restore(&i->core, state);
  i->core.now.early = i->early;
  return FA_STATUS_OK;
}

static int fa_free_fmu_state(fa_instance *i, void **state) {
  if (state && *state) i->release(i, *state);
  if (state) *state = 0;
  return FA_STATUS_OK;
}

static int fa_serialized_fmu_state_size(fa_instance *i, const char *f, const void *state, size_t *size) {
  if (!state || !size) return fa_error(i, f, "the state or size is NULL");
  *size = sizeof(fa_fmu_state);
  return FA_STATUS_OK;
}

static int fa_serialize_fmu_state(fa_instance *i, const char *f, const void *state, void *bytes, size_t size) {
  if (!state || !bytes) return fa_error(i, f, "the state or buffer is NULL");
  if (size < sizeof(fa_fmu_state)) return fa_error(i, f, "the buffer is too small");
  const char *why = fa_fmu_state_error(state);
  if (why) return fa_error(i, f, why);
  const uint64_t sum = fa_checksum(state);
  memcpy(bytes, state, sizeof(fa_fmu_state));
  memcpy((char *)bytes + offsetof(fa_fmu_state, sum), &sum, sizeof sum);
  return FA_STATUS_OK;
}

static int fa_deserialize_fmu_state(fa_instance *i, const char *f, const void *bytes, size_t size, void **state) {
  fa_fmu_state trial;
  if (!bytes || !state) return fa_error(i, f, "the buffer or state is NULL");
  if (size != sizeof trial) return fa_error(i, f, "the state has another size: it is not of this model");
  memcpy(&trial, bytes, sizeof trial);
  const char *why = fa_fmu_state_error(&trial);
  if (!why && trial.sum != fa_checksum(&trial)) why = "it is damaged";
  if (why) return fa_error(i, f, why);
  fa_prepare_again(&trial);
  fa_fmu_state *saved = *state ? *state : i->allocate(i, sizeof *saved);
  if (!saved) return fa_error(i, f, "out of memory");
  *saved = trial;
  *state = saved;
  return FA_STATUS_OK;
}

/* -- steps ------------------------------------------------------------------------------------------------------ */

static double fa_time(const fa_instance *i) {
  const fa_state *s = &i->core.now;
  return s->pending & FA_PENDING_START ? s->start : s->sim.t;
}

static int fa_do_step(fa_instance *i, const char *f, double from, double length) {
  char text[200];
  double row[3 * FA_LOGGED];
  const fa_state *s = &i->core.now;
  const double tolerance = fa_time_tolerance(fa_time(i));
  if (!(length > 0) || !(from + length - from > 0) || (from + length - s->start) / FA_RESOLUTION > 4e18) {
    snprintf(text, sizeof text, "a step of %.9g s from %.9g s cannot be done", length, from);
    return fa_error(i, f, text);
  }
  if (!(fabs(from - fa_time(i)) <= tolerance)) {
    snprintf(text, sizeof text, "the step starts at %.17g s but this instance stands at %.17g s", from, fa_time(i));
    return fa_error(i, f, text);
  }
  if (s->stop_defined && from + length > s->stop + tolerance) {
    snprintf(text, sizeof text, "the step to %.9g s passes stopTime %.9g s", from + length, s->stop);
    return fa_error(i, f, text);
  }
  if (fa_refuse_conflict(i, f)) return i->last = FA_STATUS_ERROR;
  fa_warn_of_step(i, f);
  fa_listen(i, row);
  const int failed = fa_advance(&i->core, from, length);
  fa_tell(i, f);
  if (failed) {
    i->core.now.fmi_state = FA_ERROR_STATE;
    i->last = FA_STATUS_ERROR;
    return fa_simulation_error(i, f);
  }
  return i->last = FA_STATUS_OK;
}

/* -- Model Exchange --------------------------------------------------------------------------------------------- */

/* *moved: the right-hand side jumps, so that the integrator must start afresh: states, modes, memories, inputs or
 * parameters changed. */
static int fa_update_discrete_states(fa_instance *i, const char *f, int *moved, double *next) {
  fa_state *s = &i->core.now;
  fa_sim *sim = &s->sim;
  double x[FA_SIZE(FA_NX)], d[FA_SIZE(FA_ND)], m[FA_SIZE(FA_NM)], row[3 * FA_LOGGED];
  int cursor[FA_SIZE(FA_NW)];
  if (fa_refuse_conflict(i, f)) return FA_STATUS_ERROR;
  const int starting = s->pending & FA_PENDING_START;
  memcpy(x, sim->x, sizeof x);
  memcpy(d, sim->d, sizeof d);
  memcpy(m, sim->m, sizeof m);
  memcpy(cursor, sim->cursor, sizeof cursor);
  fa_listen(i, row);
  const int failed = fa_ensure_evaluated(&i->core) || fa_process_events(&i->core);
  fa_tell(i, f);
  if (failed) {
    s->fmi_state = FA_ERROR_STATE;
    return fa_simulation_error(i, f);
  }
  *moved = starting || s->moved || memcmp(x, sim->x, sizeof x) || memcmp(d, sim->d, sizeof d) ||
           memcmp(m, sim->m, sizeof m) || memcmp(cursor, sim->cursor, sizeof cursor);
  s->moved = 0;
  memset(s->ticking, 0, sizeof s->ticking);
  *next = fa_next_event_time(s);
  return FA_STATUS_OK;
}

/* Enter event mode from the modes of Model Exchange, or from step mode. */
static int fa_enter_event_mode(fa_instance *i, const char *f) {
  fa_core *c = &i->core;
  if (!i->exchange && !i->hybrid) return fa_error(i, f, "not allowed in step mode: the instance was made without event mode");
  if (!i->exchange) fa_undo_evaluation(c);
  if (c->now.fmi_state != FA_EVENT_MODE) fa_note_clocks(&c->now);
  c->now.fmi_state = FA_EVENT_MODE;
  return FA_STATUS_OK;
}

static int fa_enter_step_mode(fa_instance *i, const char *f) {
  fa_core *c = &i->core;
  if (!i->hybrid) return fa_error(i, f, "the instance was not made for Co-Simulation with event mode");
  if (fa_evaluated(i, f)) return FA_STATUS_ERROR;
  c->kept = 0;
  c->now.fmi_state = FA_STEP_MODE;
  memset(c->now.ticking, 0, sizeof c->now.ticking);
  return FA_STATUS_OK;
}

static int fa_get_clocks(fa_instance *i, const char *f, const unsigned *vr, size_t n, unsigned char *ticks) {
  if (n && (!vr || !ticks)) return fa_error(i, f, "the references or values are NULL");
  for (size_t k = 0; k < n; k++)
    if (vr[k] < FA_VR_C || vr[k] >= FA_VR_END) return fa_invalid_reference(i, f, "not a clock", vr[k]);
  for (size_t k = 0; k < n; k++) ticks[k] = i->core.now.ticking[vr[k] - FA_VR_C];
  return FA_STATUS_OK;
}

static int fa_enter_continuous_time_mode(fa_instance *i, const char *f) {
  if (!i->exchange) return fa_error(i, f, "not for Co-Simulation");
  if (fa_evaluated(i, f)) return FA_STATUS_ERROR;
  i->core.kept = 0;
  i->core.now.fmi_state = FA_CONTINUOUS_TIME_MODE;
  return FA_STATUS_OK;
}

static int fa_set_time(fa_instance *i, const char *f, double time) {
  fa_state *s = &i->core.now;
  if (!i->exchange) return fa_error(i, f, "not for Co-Simulation");
  if (!(time - time == 0) || time + FA_STEP == time)
    return fa_error(i, f, "the time is not finite, or so large that a step is lost in rounding");
  if (s->sim.t != time) s->stale = 1;
  s->sim.t = time;
  return FA_STATUS_OK;
}

enum { FA_SET_STATES, FA_GET_STATES, FA_GET_DERIVATIVES, FA_GET_EVENT_INDICATORS, FA_GET_NOMINALS };

static int fa_get_or_set_array(fa_instance *i, const char *f, int what, double *out, const double *in, size_t n) {
  fa_sim *s = &i->core.now.sim;
  const size_t expected = what == FA_GET_EVENT_INDICATORS ? FA_NG : FA_NX;
  if (n != expected) return fa_error(i, f, "the array has the wrong length");
  if (n && !out && !in) return fa_error(i, f, "the array is NULL");
  if (what == FA_SET_STATES) {
    for (size_t k = 0; k < n; k++)
      if (!(in[k] - in[k] == 0)) return fa_log_status(i, FA_STATUS_DISCARD, f, "a state is not finite");
    memcpy(s->x, in, sizeof(double) * n);
    fa_undo_twists(s->x);
    i->core.now.stale = 1;
    return FA_STATUS_OK;
  }
  if (what != FA_GET_NOMINALS && fa_evaluated(i, f)) return FA_STATUS_ERROR;
  for (size_t k = 0; k < n; k++)
    out[k] = what == FA_GET_STATES ? s->x[k] : what == FA_GET_DERIVATIVES ? s->full[k]
           : what == FA_GET_EVENT_INDICATORS ? FA_HYSTERESIS - s->full[FA_NX + k] : fa_x_nominal[k];
  if (what == FA_GET_STATES || what == FA_GET_DERIVATIVES) fa_show_twists(out);
  return FA_STATUS_OK;
}
