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
  int logging, last;                 /* a bit for each category; status of the last step */
  void (*report)(struct fa_instance *, int status, const char *category, const char *line);
  void *(*allocate)(struct fa_instance *, size_t size);
  void (*release)(struct fa_instance *, void *made);
  char name[256];
} fa_instance;

#define FA_ALIVE INT64_C(0x6d7261786c666d66)
#define FA_CATEGORIES 5
static const char *const fa_category[] = {"logAll", "logEvents", "logStatusWarning", "logStatusDiscard", "logStatusError"};
static const char *const fa_phase_name[] = {"instantiated", "in initialization mode", "in step mode", "terminated",
                                            "in error", "in event mode", "in continuous-time mode"};

/* Loggers may take the text for a format, and FMI gives # a meaning, so % and # are taken out. */
static void fa_line(char *line, size_t size, const char *function, const char *text) {
  snprintf(line, size, "%s: %s", function, text);
  for (char *at = line; *at; at++)
    if (*at == '%' || *at == '#') *at = '_';
}

enum { FA_LOG_EVENTS = 1, FA_LOG_WARNING, FA_LOG_DISCARD, FA_LOG_ERROR };

static int fa_logs(const fa_instance *i, int category) { return i->logging & (1 << category); }

static void fa_say(fa_instance *i, int status, int category, const char *function, const char *text) {
  char line[700];
  if (!fa_logs(i, category)) return;
  fa_line(line, sizeof line, function, text);
  i->report(i, status, fa_category[category], line);
}

static int fa_refuse(fa_instance *i, int status, const char *function, const char *text) {
  fa_say(i, status, status == FA_STATUS_DISCARD ? FA_LOG_DISCARD : FA_LOG_ERROR, function, text);
  return status;
}

static int fa_no(fa_instance *i, const char *function, const char *text) {
  return fa_refuse(i, FA_STATUS_ERROR, function, text);
}

static int fa_fail(fa_instance *i, const char *function) { return fa_no(i, function, fa_explain(&i->core)); }

static int fa_bad_reference(fa_instance *i, const char *function, const char *what, unsigned vr) {
  char text[300];
  snprintf(text, sizeof text, "%s: value reference %u%s%s", what, vr, vr < FA_VR_END ? ", " : "",
           vr < FA_VR_END ? fa_name[vr] : "");
  return fa_no(i, function, text);
}

static fa_instance *fa_of(void *c) {
  fa_instance *i = (fa_instance *)c;
  return i && i->alive == FA_ALIVE ? i : 0;
}

#define FA_BIT(phase) (1 << (phase))
#define FA_EXCHANGING (FA_BIT(FA_EVENT) | FA_BIT(FA_CONTINUOUS))
#define FA_STARTED (FA_BIT(FA_INITIALISING) | FA_BIT(FA_RUNNING) | FA_EXCHANGING)
#define FA_SETTING (FA_BIT(FA_INSTANTIATED) | FA_STARTED)
#define FA_DEFINED (FA_STARTED | FA_BIT(FA_TERMINATED))
#define FA_ANY (FA_SETTING | FA_BIT(FA_TERMINATED) | FA_BIT(FA_FAILED))

/* The instance, if it is one and in one of these phases; else *status is the answer. */
static fa_instance *fa_in(void *c, int phases, const char *function) {
  fa_instance *i = fa_of(c);
  if (!i || (FA_BIT(i->core.now.phase) & phases)) return i;
  char text[100];
  snprintf(text, sizeof text, "not allowed while the instance is %s", fa_phase_name[i->core.now.phase]);
  fa_no(i, function, text);
  return 0;
}

#define FA_IN(phases)                             \
  fa_instance *i = fa_in(c, (phases), __func__);  \
  if (!i) return FA_STATUS_ERROR;

/* Why no instance can be made, or NULL. */
static const char *fa_no_instance(const char *name, const char *token) {
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
  char text[300];
  fa_state *s = &i->core.now;
  if (i->exchange || !fa_logs(i, FA_LOG_WARNING) || !(s->pending & FA_TUNED) || (s->pending & FA_STARTING)) return;
  fa_sim trial = s->sim;
  memcpy(trial.p, s->p, sizeof(double) * FA_NP);
  fa_prepare_parameters(trial.p, trial.cp);
  const double wanted = fa_choose_step(&trial);
  if (wanted >= 0.99 * s->sim.hmax) return;
  snprintf(text, sizeof text, "the parameters now need an internal step of %.3g s; that of this run, chosen at its "
           "start, stays %.3g s: results may be inaccurate or diverge; set them before initialization ends", wanted,
           s->sim.hmax);
  fa_say(i, FA_STATUS_WARNING, FA_LOG_WARNING, f, text);
}

/* -- life ------------------------------------------------------------------------------------------------------- */

static int fa_do_logging(fa_instance *i, const char *f, int on, size_t n, const char *const *categories) {
  int chosen = n ? 0 : -1;
  if (n && !categories) return fa_no(i, f, "categories is NULL");
  for (size_t k = 0; k < n; k++) {
    int found = 0;
    for (int j = 0; j < FA_CATEGORIES; j++)
      if (categories[k] && !strcmp(categories[k], fa_category[j])) found = j ? 1 << j : -1;
    if (!found) return fa_no(i, f, "unknown log category");
    chosen |= found;
  }
  i->logging = on ? i->logging | chosen : i->logging & ~chosen;
  return FA_STATUS_OK;
}

static int fa_do_setup(fa_instance *i, const char *f, double start, int with_stop, double stop) {
  fa_state *s = &i->core.now;
  if (!(start - start == 0) || start + FA_STEP == start)
    return fa_no(i, f, "startTime is not finite, or so large that a step is lost in rounding");
  if (with_stop && !(stop >= start)) return fa_no(i, f, "stopTime lies before startTime");
  s->start = start;
  s->stop_defined = with_stop != 0;
  s->stop = with_stop ? stop : 0;
  return FA_STATUS_OK;
}

/* Go to a phase in which the present instant must have values. */
static int fa_do_phase(fa_instance *i, const char *f, int phase) {
  fa_core *c = &i->core;
  if (fa_evaluated(c)) {
    c->now.phase = FA_FAILED;
    return fa_fail(i, f);
  }
  c->now.phase = c->before.phase = phase;
  return FA_STATUS_OK;
}

static int fa_do_reset(fa_instance *i) {
  fa_fresh(&i->core, i->exchange);
  i->last = FA_STATUS_OK;
  return FA_STATUS_OK;
}

/* -- values ----------------------------------------------------------------------------------------------------- */

/* Reals, or modes as whole numbers. */
static int fa_do_get(fa_instance *i, const char *f, const unsigned *vr, size_t n, double *real, int32_t *whole) {
  fa_core *c = &i->core;
  int given = 1;
  if (!n) return FA_STATUS_OK;
  if (!vr || !(real || whole)) return fa_no(i, f, "the references or values are NULL");
  for (size_t k = 0; k < n; k++) {
    const int is_mode = vr[k] >= FA_VR_M && vr[k] < FA_VR_G;
    if (vr[k] >= FA_VR_END || is_mode == (real != 0))
      return fa_bad_reference(i, f, "no variable of this type", vr[k]);
    given &= fa_is_given(&c->now, vr[k]);
  }
  if (!given) {
    if (!(FA_BIT(c->now.phase) & FA_DEFINED))
      return fa_no(i, f, "outputs and states have no value before initialization or after an error");
    if (fa_evaluated(c)) return fa_fail(i, f);
  }
  for (size_t k = 0; k < n; k++) {
    if (real) real[k] = fa_value(c, vr[k]);
    else whole[k] = (int32_t)fa_value(c, vr[k]);
  }
  return FA_STATUS_OK;
}

static int fa_do_set(fa_instance *i, const char *f, const unsigned *vr, size_t n, const double *value) {
  fa_core *c = &i->core;
  if (n && (!vr || !value)) return fa_no(i, f, "the references or values are NULL");
  for (size_t k = 0; k < n; k++) {
    if (vr[k] >= FA_VR_END || (!fa_is_parameter(vr[k]) && !fa_is_input(vr[k]) && !fa_is_start(vr[k])))
      return fa_bad_reference(i, f, "neither an input nor a parameter, nor the start of a state", vr[k]);
    if (c->now.phase > FA_INITIALISING && fa_is_start(vr[k]))
      return fa_bad_reference(i, f, "the start of a state cannot change after initialization", vr[k]);
    if (c->now.phase > FA_INITIALISING && fa_is_parameter(vr[k]) && !(fa_p_kind[vr[k] - FA_VR_P] & FA_TUNABLE))
      return fa_bad_reference(i, f, "a fixed parameter cannot change after initialization", vr[k]);
    if (c->now.phase == FA_CONTINUOUS && fa_is_parameter(vr[k]))
      return fa_bad_reference(i, f, "parameters change in event mode", vr[k]);
    const char *refusal = fa_refusal(c, vr[k], value[k]);
    if (refusal) return fa_refuse(i, FA_STATUS_DISCARD, f, refusal);
  }
  for (size_t k = 0; k < n; k++) fa_give(c, vr[k], value[k]);
  return FA_STATUS_OK;
}

static int fa_do_other(fa_instance *i, const char *f, const unsigned *vr, size_t n) {
  if (!n) return FA_STATUS_OK;
  return vr ? fa_bad_reference(i, f, "no variable of this type can be used so", vr[0])
            : fa_no(i, f, "the references are NULL");
}

static int fa_do_slopes(fa_instance *i, const char *f, const unsigned *vr, size_t n, const int32_t *order,
                        const double *value) {
  fa_core *c = &i->core;
  if (n && (!vr || !order || !value)) return fa_no(i, f, "the references, orders or values are NULL");
  if (i->exchange) return fa_no(i, f, "not for Model Exchange");
  for (size_t k = 0; k < n; k++) {
    if (!fa_is_input(vr[k])) return fa_bad_reference(i, f, "not an input", vr[k]);
    if (order[k] != 1) return fa_no(i, f, "only derivatives of order 1 are used");
    const char *refusal = fa_refusal(c, vr[k], value[k]);
    if (refusal) return fa_refuse(i, FA_STATUS_DISCARD, f, refusal);
  }
  for (size_t k = 0; k < n; k++) fa_give_slope(c, vr[k], value[k]);
  return FA_STATUS_OK;
}

static int fa_do_rates(fa_instance *i, const char *f, const unsigned *vr, size_t n, const int32_t *order,
                       double *value) {
  double rate[FA_SIZE(FA_NY)];
  if (n && (!vr || !order || !value)) return fa_no(i, f, "the references, orders or values are NULL");
  for (size_t k = 0; k < n; k++) {
    if (vr[k] < FA_VR_Y || vr[k] >= FA_VR_X) return fa_bad_reference(i, f, "not an output", vr[k]);
    if (order[k] != 1) return fa_no(i, f, "only derivatives of order 1 are known");
  }
  if (!n) return FA_STATUS_OK;
  if (fa_evaluated(&i->core)) return fa_fail(i, f);
  fa_output_rates(&i->core, rate);
  for (size_t k = 0; k < n; k++) value[k] = rate[vr[k] - FA_VR_Y];
  return FA_STATUS_OK;
}

/* J seed, or with adjoint J' seed, for the block J of the unknowns by the knowns. */
static int fa_do_directional(fa_instance *i, const char *f, const unsigned *unknown, size_t unknowns,
                             const unsigned *known, size_t knowns, const double *along, double *result, int adjoint) {
  double seed[FA_SIZE(1 + FA_NX + FA_NI)], rate[FA_SIZE(FA_NX + FA_NY + FA_NG)];
  memset(seed, 0, sizeof seed);
  if ((unknowns && (!unknown || !(adjoint ? along : result))) || (knowns && (!known || !(adjoint ? result : along))))
    return fa_no(i, f, "an argument is NULL");
  for (size_t k = 0; k < unknowns; k++)
    if (fa_unknown(unknown[k]) < 0)
      return fa_bad_reference(i, f, "only outputs, state derivatives and indicators are unknowns", unknown[k]);
  for (size_t k = 0; k < knowns; k++)
    if (fa_known(known[k]) < 0) return fa_bad_reference(i, f, "only inputs and states are knowns", known[k]);
  for (size_t k = 0; k < (adjoint ? unknowns : knowns); k++)
    if (!(along[k] - along[k] == 0)) return fa_refuse(i, FA_STATUS_DISCARD, f, "a seed is not finite");
  if (fa_evaluated(&i->core)) return fa_fail(i, f);
  if (adjoint) {
    for (size_t k = 0; k < knowns; k++) {
      seed[fa_known(known[k])] = 1;
      fa_along(&i->core, seed, rate);
      seed[fa_known(known[k])] = result[k] = 0;
      for (size_t j = 0; j < unknowns; j++) result[k] += along[j] * rate[fa_unknown(unknown[j])];
    }
    return FA_STATUS_OK;
  }
  for (size_t k = 0; k < knowns; k++) seed[fa_known(known[k])] += along[k];
  fa_along(&i->core, seed, rate);
  for (size_t k = 0; k < unknowns; k++) result[k] = rate[fa_unknown(unknown[k])];
  return FA_STATUS_OK;
}

/* -- saved states ----------------------------------------------------------------------------------------------- */

static int fa_do_save(fa_instance *i, const char *f, void **state) {
  if (!state) return fa_no(i, f, "the state is NULL");
  fa_saved *saved = *state ? *state : i->allocate(i, sizeof *saved);
  if (!saved) return fa_no(i, f, "out of memory");
  fa_save(&i->core, saved);
  *state = saved;
  return FA_STATUS_OK;
}

static int fa_do_restore(fa_instance *i, const char *f, const void *state) {
  const char *flaw = state ? fa_flaw(state) : "the state is NULL";
  if (flaw) return fa_no(i, f, flaw);
  if (((const fa_saved *)state)->state.exchange != i->exchange)
    return fa_no(i, f, "it is a state of the other kind: Co-Simulation and Model Exchange do not mix");
  fa_restore(&i->core, state);
  return FA_STATUS_OK;
}

static int fa_do_forget(fa_instance *i, void **state) {
  if (state && *state) i->release(i, *state);
  if (state) *state = 0;
  return FA_STATUS_OK;
}

static int fa_do_size(fa_instance *i, const char *f, const void *state, size_t *size) {
  if (!state || !size) return fa_no(i, f, "the state or size is NULL");
  *size = sizeof(fa_saved);
  return FA_STATUS_OK;
}

static int fa_do_serialise(fa_instance *i, const char *f, const void *state, void *bytes, size_t size) {
  if (!state || !bytes) return fa_no(i, f, "the state or buffer is NULL");
  if (size < sizeof(fa_saved)) return fa_no(i, f, "the buffer is too small");
  const char *flaw = fa_flaw(state);
  if (flaw) return fa_no(i, f, flaw);
  const uint64_t sum = fa_sum(state);
  memcpy(bytes, state, sizeof(fa_saved));
  memcpy((char *)bytes + offsetof(fa_saved, sum), &sum, sizeof sum);
  return FA_STATUS_OK;
}

static int fa_do_deserialise(fa_instance *i, const char *f, const void *bytes, size_t size, void **state) {
  fa_saved trial;
  if (!bytes || !state) return fa_no(i, f, "the buffer or state is NULL");
  if (size != sizeof trial) return fa_no(i, f, "the state has another size: it is not of this model");
  memcpy(&trial, bytes, sizeof trial);
  const char *flaw = fa_flaw(&trial);
  if (!flaw && trial.sum != fa_sum(&trial)) flaw = "it is damaged";
  if (flaw) return fa_no(i, f, flaw);
  fa_prepare_again(&trial);
  fa_saved *saved = *state ? *state : i->allocate(i, sizeof *saved);
  if (!saved) return fa_no(i, f, "out of memory");
  *saved = trial;
  *state = saved;
  return FA_STATUS_OK;
}

/* -- steps ------------------------------------------------------------------------------------------------------ */

static double fa_time(const fa_instance *i) {
  const fa_state *s = &i->core.now;
  return s->pending & FA_STARTING ? s->start : s->sim.t;
}

static int fa_do_step(fa_instance *i, const char *f, double from, double length) {
  char text[200];
  double row[3 * FA_LOGGED];
  const fa_state *s = &i->core.now;
  const double tolerance = fa_tolerance(fa_time(i));
  if (!(length > 0) || !(from + length - from > 0) || (from + length - s->start) / FA_RESOLUTION > 4e18) {
    snprintf(text, sizeof text, "a step of %.9g s from %.9g s cannot be done", length, from);
    return fa_no(i, f, text);
  }
  if (!(fabs(from - fa_time(i)) <= tolerance)) {
    snprintf(text, sizeof text, "the step starts at %.17g s but this instance stands at %.17g s", from, fa_time(i));
    return fa_no(i, f, text);
  }
  if (s->stop_defined && from + length > s->stop + tolerance) {
    snprintf(text, sizeof text, "the step to %.9g s passes stopTime %.9g s", from + length, s->stop);
    return fa_no(i, f, text);
  }
  fa_warn_of_step(i, f);
  fa_listen(i, row);
  const int failed = fa_advance(&i->core, from, length);
  fa_tell(i, f);
  if (failed) {
    i->core.now.phase = FA_FAILED;
    i->last = FA_STATUS_ERROR;
    return fa_fail(i, f);
  }
  return i->last = FA_STATUS_OK;
}

/* -- Model Exchange --------------------------------------------------------------------------------------------- */

/* *moved: the right-hand side jumps, so that the integrator must start afresh: states, modes, memories, inputs or
 * parameters changed. */
static int fa_do_discrete(fa_instance *i, const char *f, int *moved, double *next) {
  fa_state *s = &i->core.now;
  fa_sim *sim = &s->sim;
  double x[FA_SIZE(FA_NX)], d[FA_SIZE(FA_ND)], m[FA_SIZE(FA_NM)], row[3 * FA_LOGGED];
  int cursor[FA_SIZE(FA_NW)];
  const int starting = s->pending & FA_STARTING;
  memcpy(x, sim->x, sizeof x);
  memcpy(d, sim->d, sizeof d);
  memcpy(m, sim->m, sizeof m);
  memcpy(cursor, sim->cursor, sizeof cursor);
  fa_listen(i, row);
  const int failed = fa_evaluated(&i->core) || fa_events(&i->core);
  fa_tell(i, f);
  if (failed) {
    s->phase = FA_FAILED;
    return fa_fail(i, f);
  }
  *moved = starting || s->moved || memcmp(x, sim->x, sizeof x) || memcmp(d, sim->d, sizeof d) ||
           memcmp(m, sim->m, sizeof m) || memcmp(cursor, sim->cursor, sizeof cursor);
  s->moved = 0;
  *next = fa_next_event(s);
  return FA_STATUS_OK;
}

static int fa_do_continuous(fa_instance *i, const char *f) {
  if (fa_evaluated(&i->core)) return fa_fail(i, f);
  i->core.kept = 0;
  i->core.now.phase = FA_CONTINUOUS;
  return FA_STATUS_OK;
}

static int fa_do_time(fa_instance *i, const char *f, double time) {
  fa_state *s = &i->core.now;
  if (!(time - time == 0) || time + FA_STEP == time)
    return fa_no(i, f, "the time is not finite, or so large that a step is lost in rounding");
  if (s->sim.t != time) s->stale = 1;
  s->sim.t = time;
  return FA_STATUS_OK;
}

enum { FA_GIVE_X, FA_TAKE_X, FA_TAKE_RATES, FA_TAKE_GUARDS, FA_TAKE_NOMINALS };

static int fa_do_array(fa_instance *i, const char *f, int what, double *out, const double *in, size_t n) {
  fa_sim *s = &i->core.now.sim;
  const size_t expected = what == FA_TAKE_GUARDS ? FA_NG : FA_NX;
  if (n != expected) return fa_no(i, f, "the array has the wrong length");
  if (n && !out && !in) return fa_no(i, f, "the array is NULL");
  if (what == FA_GIVE_X) {
    for (size_t k = 0; k < n; k++)
      if (!(in[k] - in[k] == 0)) return fa_refuse(i, FA_STATUS_DISCARD, f, "a state is not finite");
    memcpy(s->x, in, sizeof(double) * n);
    i->core.now.stale = 1;
    return FA_STATUS_OK;
  }
  if (what != FA_TAKE_NOMINALS && fa_evaluated(&i->core)) return fa_fail(i, f);
  for (size_t k = 0; k < n; k++)
    out[k] = what == FA_TAKE_X ? s->x[k] : what == FA_TAKE_RATES ? s->full[k]
           : what == FA_TAKE_GUARDS ? FA_HYSTERESIS - s->full[FA_NX + k] : fa_x_nominal[k];
  return FA_STATUS_OK;
}
