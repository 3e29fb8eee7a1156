/* What every FMI head shares: the instants of a run, values by reference, tangents and saved states. It follows the
 * generated model and the integrator in one translation unit and knows no FMI version.
 *
 * Instants. The internal grid and the sample clocks count whole ticks of FA_RESOLUTION from the start, so neither drifts
 * and how the importer divides the time does not matter: cells of the grid are integrated one by one.
 *
 * At a communication point the model stands just before the instant: inputs set there, tuned parameters and clocks that
 * are due wait in `pending` until a value is asked for or the next step begins. A value set after one was read takes
 * the instant back (`before`) and the instant is evaluated afresh, so the order of reading and setting is immaterial.
 *
 * Co-Simulation with event mode (FMI 3) returns from a step before a switch, knot, time event or clock: these wait in
 * `pending` too, and values that are asked for before event mode are the limits from the left. */

enum { FA_PENDING_START = 1, FA_PENDING_PARAMETERS = 2, FA_PENDING_INPUTS = 4, FA_PENDING_CLOCKS = 8,
       FA_PENDING_EVENT = 16 };
/* FA_STEP_MODE is Co-Simulation's step mode, FA_CONTINUOUS_TIME_MODE is of Model Exchange, FA_EVENT_MODE of both. */
enum { FA_INSTANTIATED, FA_INITIALIZATION_MODE, FA_STEP_MODE, FA_TERMINATED, FA_ERROR_STATE, FA_EVENT_MODE,
       FA_CONTINUOUS_TIME_MODE };
enum { FA_OPEN_MIN = 1, FA_OPEN_MAX = 2, FA_TUNABLE = 4 };

/* Value references: time, parameters, inputs, outputs, states, derivatives, memories; then the modes, whole numbers; then
 * the event indicators, two for each mode; then the coordinates in whose place a twist is shown as a state; then the
 * clocks, which only FMI 3 shows. */
enum {
  FA_VR_P = 1,
  FA_VR_U = FA_VR_P + FA_NP,
  FA_VR_Y = FA_VR_U + FA_NU,
  FA_VR_X = FA_VR_Y + FA_NY,
  FA_VR_DX = FA_VR_X + FA_NX,
  FA_VR_D = FA_VR_DX + FA_NX,
  FA_VR_M = FA_VR_D + FA_ND,
  FA_VR_G = FA_VR_M + FA_NF + FA_NS,
  FA_VR_Q = FA_VR_G + FA_NG,
  FA_VR_C = FA_VR_Q + FA_NR,
  FA_VR_END = FA_VR_C + FA_NC
};

typedef struct {
  fa_sim sim;
  double p[FA_SIZE(FA_NP)], u[FA_SIZE(FA_NU)], slope[FA_SIZE(FA_NU)]; /* as the importer set them */
  double x0[FA_SIZE(FA_NX)];                                          /* starts that the importer set */
  unsigned char placed[FA_SIZE(FA_NX)];                               /* whether it set them */
  double start, stop;
  int64_t tick;                                                       /* the last instant that was passed */
  int32_t stop_defined, fmi_state, pending, stale;                        /* stale: sim.full is not that of t and x */
  int32_t moved, exchange;                                            /* moved: inputs or parameters changed since the
                                                                         last event; exchange: Model Exchange */
  double tolerance;                                                   /* that the importer gave, or 0 */
  int32_t hybrid, early;                                              /* Co-Simulation with event mode; whether its
                                                                         steps may return early */
  unsigned char ticking[FA_SIZE(FA_NC)];                              /* clocks that tick at the present event */
} fa_state;

typedef struct {
  fa_state now, before;      /* before: `now` as it stood before its instant was evaluated, if kept */
  int32_t kept, read;        /* read: y holds the outputs */
  double y[FA_SIZE(FA_NY)];
  char message[512];
} fa_core;

#define FA_MOST_PARTS 1e5                /* of a cell; a model that needs more diverges, and is refused then */

/* -- twists ------------------------------------------------------------------------------------------------------ */

/* What is shown of the states, or of their rates: twists in place of coordinates; and back. A twist stands after those
 * that its terms are made of. */
static double fa_twist_value(const double *x, int r) {
  double value = x[fa_twist_coordinate[r]];
  for (int j = fa_twist_first[r]; j < fa_twist_first[r + 1]; j++) value += fa_twist_share[j] * x[fa_twist_other[j]];
  return value;
}

static void fa_show_twists(double *x) {
  for (int r = FA_NR - 1; r >= 0; r--) x[fa_twist_coordinate[r]] = fa_twist_value(x, r);
}

static void fa_undo_twists(double *x) {
  for (int r = 0; r < FA_NR; r++)
    for (int j = fa_twist_first[r]; j < fa_twist_first[r + 1]; j++)
      x[fa_twist_coordinate[r]] -= fa_twist_share[j] * x[fa_twist_other[j]];
}

/* -- the fastest mode -------------------------------------------------------------------------------------------- */

/* The largest |eigenvalue| of a, shape (n, n), with room for two more of it behind: by Gelfand's formula, the limit of
 * |a^k|^(1/k), with k doubled by squaring. Thirty squarings leave an error of 1e-8 at a condition of 1e6. */
static double fa_spectral_radius(int n, double *a) {
  double *b = a + (size_t)n * n, *other = b + (size_t)n * n;
  double logarithm = 0, weight = 1;
  memcpy(b, a, sizeof(double) * n * n);
  for (int turn = 0; turn <= 30; turn++, weight /= 2) {
    double size = 0;
    for (int i = 0; i < n * n; i++) size = fmax(size, fabs(b[i]));
    if (!(size > 0)) return 0;
    logarithm += weight * log(size);
    for (int i = 0; i < n; i++)
      for (int j = 0; j < n; j++) {
        double sum = 0;
        for (int k = 0; k < n; k++) sum += (b[i * n + k] / size) * (b[k * n + j] / size);
        other[i * n + j] = sum;
      }
    double *swap = b;
    b = other;
    other = swap;
  }
  return exp(logarithm);
}

#ifdef FA_ADAPTIVE
/* The largest error of a state as it is shown, over tolerance * (|state| + nominal): the measure of Model Exchange. */
static double fa_step_error(const fa_sim *s, const double *x1, const double *e) {
  double shown[FA_SIZE(FA_NX)], error[FA_SIZE(FA_NX)], worst = 0;
  memcpy(shown, x1, sizeof(double) * FA_NX);
  memcpy(error, e, sizeof(double) * FA_NX);
  fa_show_twists(shown);
  fa_show_twists(error);
  for (int i = 0; i < FA_NX; i++) {
    const double share = fabs(error[i]) / (s->tolerance * (fabs(shown[i]) + fa_x_nominal[i]));
    if (!(share <= worst)) worst = share;
    if (share != share) return share;
  }
  return worst;
}
#endif

/* -- start ------------------------------------------------------------------------------------------------------ */

static void fa_reset_core(fa_core *c, int exchange, int hybrid, int early) {
  memset(c, 0, sizeof *c);
  c->now.exchange = exchange;
  c->now.hybrid = hybrid;
  c->now.early = early;
  memcpy(c->now.p, fa_p_default, sizeof(double) * FA_NP);
  memcpy(c->now.u, fa_u_start, sizeof(double) * FA_NU);
  c->now.pending = FA_PENDING_START;
}

static double fa_tick_time(const fa_state *s, int64_t tick) { return s->start + (double)tick * FA_RESOLUTION; }

static int fa_due_clocks(int64_t tick, double *fire) {
  int any = 0;
  for (int k = 0; k < FA_NC; k++) {
    fire[k] = tick >= fa_clock_offset[k] && (tick - fa_clock_offset[k]) % fa_clock_period[k] == 0;
    any |= fire[k] != 0;
  }
  return any;
}

static int64_t fa_next_tick(int64_t tick) {
  int64_t next = tick - tick % FA_STEP_TICKS + FA_STEP_TICKS;
  for (int k = 0; k < FA_NC; k++) {
    const int64_t since = tick - fa_clock_offset[k], period = fa_clock_period[k];
    const int64_t hit = since < 0 ? fa_clock_offset[k] : tick - since % period + period;
    if (hit < next) next = hit;
  }
  return next;
}

/* The longest internal step that resolves the fastest mode at the parameters and states of sim, joints sliding and
 * contacts open or closed; as engine/step.py chooses it. Lightly damped modes are followed to the end of the run as if
 * parameters changed their rate like that of the fastest mode: over rate * time radians RK4 is late by
 * rate * time * (rate * step)^4 / 120, so the step goes with rate^-1.25. */
static double fa_choose_step(const fa_sim *sim) {
  static const double level[] = {0, 1, -1};
  double seed[FA_SIZE(1 + FA_NX + FA_NI)] = {0}, along[FA_SIZE(FA_NX + FA_NY + FA_NG)];
  double u[FA_SIZE(FA_NI)] = {0}, d[FA_SIZE(FA_ND)] = {0}, m[FA_SIZE(FA_NM)] = {0}, cm[FA_SIZE(FA_NCM)];
  double rate = 0;
  for (int i = 0; i < FA_NU; i++) u[i] = fa_u_typical[i];
  double *jacobian = malloc(sizeof(double) * FA_SIZE(3 * FA_NX * FA_NX));
  if (!jacobian) return FA_HMAX;
  for (int l = 0; l < (FA_NS ? 3 : 1); l++) {
    for (int k = 0; k < FA_NF + FA_NS; k++) m[k] = k < FA_NF ? 1 : level[l];
    fa_prepare_modes(m, sim->p, sim->cp, cm);
    for (int j = 0; j < FA_NX; j++) {
      seed[1 + j] = 1;
      fa_tangent(0, sim->x, u, d, m, sim->p, sim->cp, cm, seed, along);
      seed[1 + j] = 0;
      for (int i = 0; i < FA_NX; i++) jacobian[i * FA_NX + j] = along[i];
    }
    if (!fa_finite(jacobian, FA_NX * FA_NX)) continue;
    rate = fmax(rate, fa_spectral_radius(FA_NX, jacobian));
  }
  free(jacobian);
  if (!(rate > 0)) return FA_STEP;
  const double following = FA_FOLLOWING * pow(FA_RATE / rate, 1.25);
  return fmax(fmin(FA_STEP, fmin(FA_STEP_PER_RATE / rate, following)), FA_STEP / FA_MOST_PARTS);
}

/* The state at the start; at the default parameters and states it is the exporter's own, to the last bit. */
static int fa_initialize(fa_state *s) {
  fa_sim *sim = &s->sim;
  int own = memcmp(s->p, fa_p_default, sizeof(double) * FA_NP) == 0;
  memset(sim, 0, sizeof *sim);
  sim->t = s->start;
  sim->hmax = FA_HMAX;
  memcpy(sim->p, s->p, sizeof(double) * FA_NP);
  if (own) {
    memcpy(sim->x, fa_x_default, sizeof(double) * FA_NX);
    memcpy(sim->d, fa_d_default, sizeof(double) * FA_ND);
  } else {
    double x[FA_SIZE(FA_NX)], d[FA_SIZE(FA_ND)];
    fa_prepare_parameters(sim->p, sim->cp);
    fa_initial_state(0, sim->x, sim->base, sim->d, sim->m, sim->p, sim->cp, sim->cm, 0, x);
    fa_initial_memory(0, sim->x, sim->base, sim->d, sim->m, sim->p, sim->cp, sim->cm, 0, d);
    memcpy(sim->x, x, sizeof(double) * FA_NX);
    memcpy(sim->d, d, sizeof(double) * FA_ND);
  }
  for (int k = 0; k < FA_NX; k++)
    if (s->placed[k]) {
      sim->x[k] = s->x0[k];
      own = 0;
    }
  if (!own) {
    fa_prepare_parameters(sim->p, sim->cp);
    sim->hmax = fa_choose_step(sim);
  }
#ifdef FA_ADAPTIVE
  sim->h = sim->hmax;
  sim->tolerance = s->tolerance > 0 ? s->tolerance : FA_TOLERANCE;
#endif
  for (int k = 0; k < FA_NM; k++) sim->m[k] = NAN;                /* the integrator decides */
  for (int i = 0; i < FA_NU; i++) fa_set_input(sim, i, s->u[i], s->slope[i]);
  return fa_start(sim);
}

static int fa_tick_clocks(fa_state *s) {
  double fire[FA_SIZE(FA_NC)];
  return fa_due_clocks(s->tick, fire) ? fa_tick(&s->sim, fire) : FA_OK;
}

/* Bring s from just before its instant to just after: tuned parameters, inputs, modes, clocks. */
static int fa_apply_pending(fa_state *s) {
  fa_sim *sim = &s->sim;
  const int what = s->pending;
  s->pending = 0;
  if (what & FA_PENDING_START) {
    if (fa_initialize(s)) return sim->status;
    return fa_tick_clocks(s);
  }
  if (what & FA_PENDING_EVENT) {
    fa_switch(sim);
    sim->events++;
    fa_table_knots(sim);
    if (fa_time_events(sim) && sim->status) return sim->status;
    if (fa_settle(sim)) return sim->status;
  }
  if (what & FA_PENDING_PARAMETERS) {
    memcpy(sim->p, s->p, sizeof(double) * FA_NP);
    fa_parameters_changed(sim);
    if (fa_time_events(sim) && sim->status) return sim->status;
  }
  if (what & FA_PENDING_INPUTS)
    for (int i = 0; i < FA_NU; i++) fa_set_input(sim, i, s->u[i], s->slope[i]);
  if ((what & (FA_PENDING_PARAMETERS | FA_PENDING_INPUTS)) && fa_settle(sim)) return sim->status;
  if (what & FA_PENDING_CLOCKS) return fa_tick_clocks(s);
  return sim->status;
}

/* An event waits for event mode. */
static int fa_event_waits(const fa_state *s) {
  return s->hybrid && s->fmi_state == FA_STEP_MODE && s->pending & (FA_PENDING_EVENT | FA_PENDING_CLOCKS);
}

/* Values just before an event that waits, with the inputs as they are set. */
static int fa_limit_from_the_left(fa_core *c) {
  fa_state *s = &c->now;
  if (!c->kept) c->before = *s;
  c->kept = 1;
  if (s->pending & FA_PENDING_INPUTS) {
    c->read = s->sim.rated = 0;
    for (int i = 0; i < FA_NU; i++) fa_set_input(&s->sim, i, s->u[i], s->slope[i]);
  }
  return fa_update_derivative(&s->sim);
}

/* Values at the present instant are wanted. */
static int fa_ensure_evaluated(fa_core *c) {
  fa_state *s = &c->now;
  if (fa_event_waits(s)) return fa_limit_from_the_left(c);
  if (s->stale) {
    s->stale = c->read = 0;
    fa_evaluate(&s->sim);
    if (!fa_finite(s->sim.full, FA_NX)) return fa_not_finite(&s->sim);
  }
  if (!s->pending) return s->sim.status;
  c->before = c->now;
  c->kept = 1;
  c->read = 0;
  return fa_apply_pending(&c->now);
}

/* The present instant is about to be changed. */
static void fa_undo_evaluation(fa_core *c) {
  c->read = 0;
  if (c->kept) c->now = c->before;
  c->kept = 0;
}

/* The present instant is settled for good. */
static int fa_commit(fa_core *c) {
  c->kept = c->read = 0;
  return c->now.pending ? fa_apply_pending(&c->now) : c->now.sim.status;
}

/* -- steps ------------------------------------------------------------------------------------------------------ */

/* Rounding in the importer's clock that is taken to mean the same instant. */
static double fa_time_tolerance(double t) { return fmin(1e-8 * fmax(1, fabs(t)), 0.01 * FA_STEP); }

/* Integrate over `length` from where the importer says `from` is. Instants of the grid are hit exactly whichever of the
 * two clocks meets them; off the grid the importer's clock holds. */
static int fa_advance(fa_core *c, double from, double length) {
  fa_state *s = &c->now;
  if (fa_commit(c)) return s->sim.status;
  const double began = s->sim.t, own = began + length, given = from + length;
  const double low = fmin(own, given), high = fmax(own, given);
  const double snap = 1e-6 * FA_STEP + 4 * 2.220446049250313e-16 * fabs(high);
  s->sim.pausing = s->hybrid && s->early;
  s->sim.paused = 0;
  for (;;) {
    const int64_t next = fa_next_tick(s->tick);
    const double at = fa_tick_time(s, next);
    if (at > high + snap) {
      if (given > s->sim.t && fa_integrate(&s->sim, given)) return s->sim.status;
      break;
    }
    if (fa_integrate(&s->sim, at)) return s->sim.status;
    if (s->sim.paused) break;
    s->tick = next;
    double fire[FA_SIZE(FA_NC)];
    const int due = fa_due_clocks(next, fire), last = at >= low - snap;
    if (due && (last || s->sim.pausing)) s->pending |= FA_PENDING_CLOCKS;
    if (last || s->pending & FA_PENDING_CLOCKS) break;
    if (due && fa_tick(&s->sim, fire)) return s->sim.status;
  }
  if (s->sim.paused) s->pending |= FA_PENDING_EVENT;
  s->sim.pausing = s->sim.paused = 0;
  for (int i = 0; i < FA_NU; i++)
    if (s->slope[i] != 0) {                                  /* a slope lasts one step; then the input holds */
      s->u[i] += s->slope[i] * (s->sim.t - began);
      s->slope[i] = 0;
      s->pending |= FA_PENDING_INPUTS;
    }
  return FA_OK;
}

static const char *fa_simulation_message(fa_core *c) {
  const fa_sim *s = &c->now.sim;
  const char *mode = FA_NM && s->status != FA_NOT_FINITE ? fa_mode_name[s->culprit] : "";
  if (s->status == FA_NOT_FINITE)
    snprintf(c->message, sizeof c->message, "the simulation diverged at t = %.9g s: state '%s' is not finite", s->t,
             FA_NX ? fa_name[FA_VR_X + s->culprit] : "");
  else if (s->status == FA_CHATTER)
    snprintf(c->message, sizeof c->message, "mode '%s' switches without end at t = %.9g s", mode, s->t);
  else
    snprintf(c->message, sizeof c->message, "no consistent mode was found for '%s' at t = %.9g s", mode, s->t);
  return c->message;
}

/* -- Model Exchange --------------------------------------------------------------------------------------------- */

#define FA_HYSTERESIS 1e-9                       /* a guard that is exactly zero after its event is not at its event */

static double fa_next_clock_time(const fa_state *s, int64_t *tick) {
  *tick = INT64_MAX;
  for (int k = 0; k < FA_NC; k++) {
    const int64_t since = s->tick - fa_clock_offset[k], period = fa_clock_period[k];
    const int64_t hit = since < 0 ? fa_clock_offset[k] : s->tick - since % period + period;
    if (hit < *tick) *tick = hit;
  }
  return FA_NC ? fa_tick_time(s, *tick) : HUGE_VAL;
}

/* Let everything happen that is due at the present time: knots, time events, switches, clocks. */
static int fa_process_events(fa_core *c) {
  fa_state *s = &c->now;
  int64_t next;
  if (fa_commit(c)) return s->sim.status;
  s->stale = 0;
  fa_table_knots(&s->sim);
  if (fa_time_events(&s->sim) && s->sim.status) return s->sim.status;
  if (fa_settle(&s->sim)) return s->sim.status;
  while (fa_next_clock_time(s, &next) <= s->sim.t + 1e-9 * FA_STEP) {
    s->tick = next;
    if (fa_tick_clocks(s)) return s->sim.status;
  }
  return FA_OK;
}

/* Note which clocks tick at the event that begins. */
static void fa_note_clocks(fa_state *s) {
  double fire[FA_SIZE(FA_NC)] = {0};
  int64_t tick = s->tick;
  int now = s->pending & (FA_PENDING_CLOCKS | FA_PENDING_START);
  if (s->exchange && !(s->pending & FA_PENDING_START)) now = fa_next_clock_time(s, &tick) <= s->sim.t + 1e-9 * FA_STEP;
  if (now) fa_due_clocks(tick, fire);
  for (int k = 0; k < FA_NC; k++) s->ticking[k] = now && fire[k] != 0;
}

static double fa_next_event_time(const fa_state *s) {
  int event;
  int64_t tick;
  return fmin(fa_next_knot(&s->sim, &event), fa_next_clock_time(s, &tick));
}

/* -- values by reference ---------------------------------------------------------------------------------------- */

static int fa_is_parameter(unsigned vr) { return vr >= FA_VR_P && vr < FA_VR_U; }
static int fa_is_input(unsigned vr) { return vr >= FA_VR_U && vr < FA_VR_Y; }

/* The state of the model whose start a reference holds, or -1. */
static int fa_start_index(unsigned vr) {
  int k = -1;
  if (vr >= FA_VR_X && vr < FA_VR_DX && fa_state_twist[vr - FA_VR_X] < 0) k = (int)vr - FA_VR_X;
  if (vr >= FA_VR_Q && vr < FA_VR_C) k = fa_twist_coordinate[vr - FA_VR_Q];
  return k >= 0 && fa_x_exact[k] ? k : -1;
}

static int fa_is_start(unsigned vr) { return fa_start_index(vr) >= 0; }

/* Readable without evaluating the model. */
static int fa_is_given(const fa_state *s, unsigned vr) {
  return vr < FA_VR_Y || (s->fmi_state == FA_INSTANTIATED && fa_is_start(vr));
}

/* Of an evaluated instant, or of what was given. */
static double fa_get_value(fa_core *c, unsigned vr) {
  const fa_state *s = &c->now;
  if (vr == 0) return s->fmi_state < FA_INITIALIZATION_MODE || (s->pending & FA_PENDING_START) ? s->start : s->sim.t;
  if (vr < FA_VR_U) return s->p[vr - FA_VR_P];
  if (vr < FA_VR_Y) return s->u[vr - FA_VR_U];
  if (vr < FA_VR_X) {
    if (!c->read) fa_read_outputs(&s->sim, c->y);
    c->read = 1;
    return c->y[vr - FA_VR_Y];
  }
  if (vr < FA_VR_DX || (vr >= FA_VR_Q && vr < FA_VR_C)) {
    const int r = vr < FA_VR_DX ? fa_state_twist[vr - FA_VR_X] : -1;
    if (r >= 0) return fa_twist_value(s->sim.x, r);
    const int k = vr < FA_VR_DX ? (int)vr - FA_VR_X : fa_twist_coordinate[vr - FA_VR_Q];
    return s->fmi_state > FA_INSTANTIATED ? s->sim.x[k] : s->placed[k] ? s->x0[k] : fa_x_default[k];
  }
  if (vr < FA_VR_D) {
    const int r = fa_state_twist[vr - FA_VR_DX];
    return r >= 0 ? fa_twist_value(s->sim.full, r) : s->sim.full[vr - FA_VR_DX];
  }
  if (vr < FA_VR_M) return s->sim.d[vr - FA_VR_D];
  if (vr < FA_VR_G) return s->sim.m[vr - FA_VR_M];
  return FA_HYSTERESIS - s->sim.full[FA_NX + vr - FA_VR_G];
}

/* Why the value may not be given to an input or parameter, or NULL. */
static const char *fa_value_error(fa_core *c, unsigned vr, double value) {
  if (!(value - value == 0)) {
    snprintf(c->message, sizeof c->message, "%s cannot be %g: it must be finite", fa_name[vr], value);
    return c->message;
  }
  if (!fa_is_parameter(vr)) return 0;
  const int k = (int)vr - FA_VR_P, kind = fa_p_kind[k];
  const int low = kind & FA_OPEN_MIN ? !(value > fa_p_min[k]) : !(value >= fa_p_min[k]);
  const int high = kind & FA_OPEN_MAX ? !(value < fa_p_max[k]) : !(value <= fa_p_max[k]);
  if (!low && !high) return 0;
  snprintf(c->message, sizeof c->message, "%s cannot be %.9g: it must be %s %.9g", fa_name[vr], value,
           low ? (kind & FA_OPEN_MIN ? "above" : "at least") : (kind & FA_OPEN_MAX ? "below" : "at most"),
           low ? fa_p_min[k] : fa_p_max[k]);
  return c->message;
}

/* What a block refuses of the parameters that wait to be taken, two against one another, or NULL. Each alone is in
 * range, and an importer sets them one by one, so they are compared when they begin to count. */
static const char *fa_parameter_conflict(fa_core *c) {
  const double *p = c->now.p;
  if (!(c->now.pending & (FA_PENDING_START | FA_PENDING_PARAMETERS))) return 0;
  for (int r = 0; r < FA_RELATIONS; r++) {
    const int a = fa_relation_first[r], b = fa_relation_second[r], meaning = fa_relation_meaning[r];
    if (!(meaning == 0 ? p[a] < p[b] : meaning == 1 ? p[a] <= p[b] : p[a] >= p[b])) continue;
    snprintf(c->message, sizeof c->message, "%.120s = %.9g %s %.120s = %.9g", fa_name[FA_VR_P + a], p[a],
             fa_relation_words[r], fa_name[FA_VR_P + b], p[b]);
    return c->message;
  }
  return 0;
}

static void fa_set_value(fa_core *c, unsigned vr, double value) {
  fa_state *s = &c->now;
  if (fa_is_start(vr)) {
    const int k = fa_start_index(vr);
    fa_undo_evaluation(c);
    s->x0[k] = value;
    s->placed[k] = memcmp(&value, &fa_x_default[k], sizeof value) != 0;
  } else if (s->fmi_state == FA_CONTINUOUS_TIME_MODE) {                           /* the integrator will meet the guards */
    s->u[vr - FA_VR_U] = value;
    fa_set_input(&s->sim, (int)vr - FA_VR_U, value, 0);
    s->stale = 1;
  } else if (fa_is_input(vr)) {
    const int i = (int)vr - FA_VR_U;
    if (s->u[i] == value && s->slope[i] == 0) return;
    fa_undo_evaluation(c);
    s->u[i] = value;
    s->slope[i] = 0;
    s->pending |= FA_PENDING_INPUTS;
    s->moved = 1;
  } else {
    const int i = (int)vr - FA_VR_P;
    if (s->p[i] == value) return;
    fa_undo_evaluation(c);
    if (s->fmi_state > FA_INITIALIZATION_MODE && (s->pending & FA_PENDING_START)) { /* start belongs to the old value */
      fa_apply_pending(s);
      s->pending = 0;
    }
    s->p[i] = value;
    s->moved = 1;
    if (!(s->pending & FA_PENDING_START)) s->pending |= FA_PENDING_PARAMETERS;
  }
}

static void fa_set_input_derivative(fa_core *c, unsigned vr, double slope) {
  const int i = (int)vr - FA_VR_U;
  if (c->now.slope[i] == slope || fa_u_coupled[i]) return;             /* the coupling knows the motion better */
  fa_undo_evaluation(c);
  c->now.slope[i] = slope;
  c->now.pending |= FA_PENDING_INPUTS;
}

/* -- tangents --------------------------------------------------------------------------------------------------- */

/* d(derivatives, outputs, guards) for d(time), d(states) and d(inputs), with modes and memories held. */
static void fa_directional_derivative(const fa_core *c, const double *seed, double *result) {
  const fa_sim *s = &c->now.sim;
  double u[FA_SIZE(FA_NI)];
  fa_inputs(s, s->t, u);
  fa_tangent(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, seed, result);
  for (int k = 0; k < FA_NG; k++) result[FA_NX + FA_NY + k] *= -1;    /* an indicator falls as its guard rises */
}

/* The same of the states as they are shown, for a seed of them. */
static void fa_shown_derivative(const fa_core *c, const double *seed, double *result) {
  double own[FA_SIZE(1 + FA_NX + FA_NI)];
  memcpy(own, seed, sizeof own);
  fa_undo_twists(own + 1);
  fa_directional_derivative(c, own, result);
  fa_show_twists(result);
}

/* Where a reference stands in the seed, or in the result; -1 if it has no place there. */
static int fa_known_index(unsigned vr) {
  if (vr >= FA_VR_X && vr < FA_VR_DX) return 1 + (int)vr - FA_VR_X;
  return fa_is_input(vr) ? 1 + FA_NX + (int)vr - FA_VR_U : -1;
}

static int fa_unknown_index(unsigned vr) {
  if (vr >= FA_VR_DX && vr < FA_VR_D) return (int)vr - FA_VR_DX;
  if (vr >= FA_VR_G && vr < FA_VR_Q) return FA_NX + FA_NY + (int)vr - FA_VR_G;
  return vr >= FA_VR_Y && vr < FA_VR_X ? FA_NX + (int)vr - FA_VR_Y : -1;
}

/* Time derivatives of the outputs, shape (outputs,), from an evaluated instant. */
static void fa_output_derivatives(const fa_core *c, double *rate) {
  const fa_sim *s = &c->now.sim;
  double seed[FA_SIZE(1 + FA_NX + FA_NI)], result[FA_SIZE(FA_NX + FA_NY + FA_NG)];
  seed[0] = 1;
  for (int i = 0; i < FA_NX; i++) seed[1 + i] = s->full[i];
  for (int i = 0; i < FA_NI; i++) seed[1 + FA_NX + i] = s->slope[i];
  fa_directional_derivative(c, seed, result);
  for (int i = 0; i < FA_NY; i++) rate[i] = result[FA_NX + i];
}

/* -- saved states ----------------------------------------------------------------------------------------------- */

#define FA_MAGIC UINT64_C(0x32306d7261786c66)                  /* "flxarm02" */

typedef struct {
  uint64_t magic, model, size, sum;                            /* sum: of serialised states only */
  fa_state state;
} fa_fmu_state;

static uint64_t fa_checksum(const fa_fmu_state *saved) {
  const unsigned char *bytes = (const unsigned char *)&saved->state;
  uint64_t sum = UINT64_C(1469598103934665603);
  for (size_t i = 0; i < sizeof saved->state; i++) sum = (sum ^ bytes[i]) * UINT64_C(1099511628211);
  return sum;
}

static void fa_save(const fa_core *c, fa_fmu_state *saved) {
  saved->magic = FA_MAGIC;
  saved->model = FA_MODEL_HASH;
  saved->size = sizeof *saved;
  saved->sum = 0;
  memcpy(&saved->state, c->kept ? &c->before : &c->now, sizeof saved->state);
}

static int fa_in_bounds(int k, double value) {
  const int kind = fa_p_kind[k];
  return value - value == 0 && (kind & FA_OPEN_MIN ? value > fa_p_min[k] : value >= fa_p_min[k]) &&
         (kind & FA_OPEN_MAX ? value < fa_p_max[k] : value <= fa_p_max[k]);
}

/* Whether the part that the integrator owns can be one that it left: all that indexes, counts or is divided by. Numbers
 * that are not finite harm nothing; a step with them fails. */
static int fa_sound_run(const fa_state *s) {
  const fa_sim *sim = &s->sim;
  if (!(sim->t - sim->t == 0)) return 0;
  for (int k = 0; k < FA_NP; k++)
    if (!fa_in_bounds(k, sim->p[k])) return 0;
  for (int k = 0; k < FA_NM; k++) {
    const double m = sim->m[k];
    if (k < FA_NF + FA_NS ? m != -1 && m != 0 && m != 1 : !(m >= 0 && m < 9e15)) return 0;
  }
  for (int i = 0; i < FA_NW; i++)
    if (sim->cursor[i] < -1 || sim->cursor[i] >= fa_table_length[i]) return 0;
#ifdef FA_LINES
  for (int l = 0; l < FA_NL; l++)
    if (sim->newest[l] < 0 || sim->newest[l] >= fa_line_size[l]) return 0;
#endif
  if (sim->status < FA_OK || sim->status > FA_NO_MODE) return 0;
  if (sim->culprit < 0 || sim->culprit >= (sim->status == FA_NOT_FINITE ? FA_SIZE(FA_NX) : FA_SIZE(FA_NM))) return 0;
  if (!(sim->hmax > 0 && sim->hmax <= FA_STEP)) return 0;
#ifdef FA_ADAPTIVE
  if (!(sim->h > 0 && sim->h - sim->h == 0 && sim->tolerance > 0 && sim->tolerance - sim->tolerance == 0)) return 0;
#endif
  if (s->tick < 0 || s->tick > INT64_C(4000000000000000000)) return 0;
  const double behind = sim->t - fa_tick_time(s, s->tick);      /* of the last instant: what a step makes good */
  return s->fmi_state != FA_STEP_MODE || fabs(behind) <= 2 * FA_STEP + 1e-9 * fabs(sim->t);
}

/* Whether every field of a state is one that an instance can have; a checksum can be forged. */
static int fa_sound(const fa_state *s) {
  if (s->fmi_state < FA_INSTANTIATED || s->fmi_state > FA_CONTINUOUS_TIME_MODE || s->fmi_state == FA_ERROR_STATE) return 0;
  if ((s->exchange & ~1) || (s->hybrid & ~1) || (s->early & ~1) || (s->exchange && (s->hybrid || s->early))) return 0;
  if (s->exchange ? s->fmi_state == FA_STEP_MODE : s->fmi_state >= (s->hybrid ? FA_CONTINUOUS_TIME_MODE : FA_EVENT_MODE))
    return 0;
  if (s->pending & ~(FA_PENDING_START | FA_PENDING_PARAMETERS | FA_PENDING_INPUTS | FA_PENDING_CLOCKS |
                     (s->hybrid ? FA_PENDING_EVENT : 0))) return 0;
  for (int k = 0; k < FA_NC; k++)
    if (s->ticking[k] > 1) return 0;
  if (s->fmi_state == FA_INSTANTIATED && !(s->pending & FA_PENDING_START)) return 0;
  if (!(s->start - s->start == 0) || s->stop != s->stop || !(s->tolerance >= 0 && s->tolerance <= 1)) return 0;
  if (!fa_finite(s->u, FA_NU) || !fa_finite(s->slope, FA_NU)) return 0;
  for (int k = 0; k < FA_NP; k++)
    if (!fa_in_bounds(k, s->p[k])) return 0;
  for (int k = 0; k < FA_NX; k++)
    if (s->placed[k] > fa_x_exact[k] || !(s->x0[k] - s->x0[k] == 0)) return 0;
  return s->pending & FA_PENDING_START ? s->tick == 0 : fa_sound_run(s);
}

/* Why a saved state cannot be used, or NULL. */
static const char *fa_fmu_state_error(const fa_fmu_state *saved) {
  if (saved->magic != FA_MAGIC) return "it is not a state of a flexarm FMU";
  if (saved->model != FA_MODEL_HASH) return "it belongs to another model or export";
  if (saved->size != sizeof *saved) return "its size is wrong";
  return fa_sound(&saved->state) ? 0 : "it is damaged";
}

/* Prepare again what follows from parameters and modes, so that nothing of it need be believed. */
static void fa_prepare_again(fa_fmu_state *saved) {
  if (!(saved->state.pending & FA_PENDING_START)) fa_parameters_changed(&saved->state.sim);
}

static void fa_restore(fa_core *c, const fa_fmu_state *saved) {
  memcpy(&c->now, &saved->state, sizeof c->now);
  c->now.sim.log = 0;
  c->now.sim.log_length = c->now.sim.log_capacity = 0;
  c->now.sim.listener = 0;
#ifdef FA_ADAPTIVE
  c->now.sim.ready = 0;
#endif
  c->kept = c->read = 0;
}
