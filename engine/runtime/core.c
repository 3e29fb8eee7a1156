/* The integrator: fixed-step RK4 with event location and exact stick. It follows the generated model code in one
 * translation unit. Modes, in order: FA_NF frictions and FA_NS switches in {-1, 0, +1}, then FA_NT counters of time
 * events. Each of the first two kinds has two guards, positive when violated.
 *
 * Everything that changes during a run lies in one struct, so copying the struct saves the state; its pointers are the
 * caller's log and listener, which an FMU leaves NULL. */

/* What tangents need to hear of; nothing otherwise. See tangent.c. */
#ifndef FA_HOOKS
#define FA_ON_TARGET(s, event, i, n) /* the next step ends at part i of n of the way to a fixed or event instant */
#define FA_ON_STEP(s, h, guard)      /* a step of length h is about to be taken; guard >= 0 if it ends on that guard */
#define FA_ON_STOP(s, coordinate)    /* a sliding coordinate's speed was set to zero */
#define FA_ON_TICK(s, fire)          /* memories are about to be updated */
#endif

#define FA_SIZE(n) ((n) > 0 ? (n) : 1)
#ifdef FA_BYTECODE
#define FA_ROOM(n) FA_MOST
#define FA_ROOM_LINE FA_MOST_LINE
#else
#define FA_ROOM(n) FA_SIZE(n)
#define FA_ROOM_LINE FA_SIZE(FA_NLS)
#endif
#define FA_NG (2 * (FA_NF + FA_NS))
#define FA_NM (FA_NF + FA_NS + FA_NT)
#define FA_NI (FA_NU + FA_NW)
#define FA_EVENTS_PER_STEP 200
#define FA_SNAP 1e-12

enum { FA_OK = 0, FA_NOT_FINITE = 1, FA_CHATTER = 2, FA_CANCELLED = 3, FA_NO_MODE = 4 };

typedef struct {
  double t;                                                      /* time of x */
  double x[FA_ROOM(FA_NX)], d[FA_ROOM(FA_ND)], m[FA_ROOM(FA_NM)], p[FA_ROOM(FA_NP)];
  double cp[FA_ROOM(FA_NCP)], cm[FA_ROOM(FA_NCM)];               /* prepared from p, and from p and m */
  double base[FA_ROOM(FA_NI)], slope[FA_ROOM(FA_NI)], from[FA_ROOM(FA_NI)]; /* inputs: base + slope (t - from) */
  double full[FA_ROOM(FA_NX) + FA_ROOM(FA_NG)];                  /* dx/dt and guards at t */
  int rated;                                                     /* whether dx/dt in full is that at t */
  double next[FA_ROOM(FA_NT)];                                   /* instants of the next time events */
  int cursor[FA_ROOM(FA_NW)];                                    /* knot of each table that holds at t */
  int newest[FA_ROOM(FA_NL)];                                    /* where in its ring the last value is */
  double hmax;
  int64_t steps, events;
  int status, culprit;                                           /* culprit: index of a state or mode */
  double *log; int64_t log_length, log_capacity;                 /* (time, mode, new value) rows, or NULL */
  void *listener;                                                /* whose the hooks are */
#ifdef FA_STAGED
  const int64_t *stage;                                          /* how many instants ago what is read entered its line */
#endif
#ifdef FA_BYTECODE
  const fa_code *code;                                           /* the model's functions and tables; see bytecode.c */
  double *file;                                                  /* the values that they work on */
#endif
#ifdef FA_CANCELLABLE
  const volatile int32_t *cancel;                                /* not 0 once the run is to end; or NULL */
#endif
#ifdef FA_PAUSABLE
  int pausing, paused;                                           /* stop before events; whether that happened */
#endif
#ifdef FA_ADAPTIVE
  double h, tolerance;                                           /* next step to be tried; error allowed in a step */
  const void *ready;                                             /* the trial of the step that is about to be taken */
#endif
  double line[FA_ROOM_LINE];                                     /* values in the delay lines, rings one after another; last */
} fa_sim;

static int fa_finite(const double *a, int n) {
  double none = 0;
  for (int i = 0; i < n; i++) none += a[i] - a[i];
  return none == 0;
}

static void fa_inputs(const fa_sim *s, double t, double *u) {
  for (int i = 0; i < FA_NI; i++) u[i] = s->base[i] + s->slope[i] * (t - s->from[i]);
}

static void fa_set_input(fa_sim *s, int i, double value, double slope) {
  s->base[i] = value; s->slope[i] = slope; s->from[i] = s->t;
}

/* -- parameters, modes, time events ----------------------------------------------------------------------------- */

static void fa_modes_changed(fa_sim *s) {
  fa_prepare_modes(s->m, s->p, s->cp, s->cm);
  if (FA_NT) fa_following(s->t, s->x, s->base, s->d, s->m, s->p, s->cp, s->cm, 0, s->next);
}

static void fa_parameters_changed(fa_sim *s) {
  fa_prepare_parameters(s->p, s->cp);
  fa_modes_changed(s);
}

static void fa_evaluate(fa_sim *s) {
  double u[FA_SIZE(FA_NI)];
  fa_inputs(s, s->t, u);
  fa_full(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, 0, s->full);
  s->rated = 1;
}

static void fa_set_mode(fa_sim *s, int k, double value) {
  s->m[k] = value;
  if (s->log && s->log_length < s->log_capacity) {
    double *row = s->log + 3 * s->log_length++;
    row[0] = s->t; row[1] = k; row[2] = value;
  }
}

/* Change every mode whose guard is violated at the present state; of several sticking joints only the one furthest
 * beyond its level breaks away, because its slip may relieve the others. Returns whether anything changed. */
static int fa_switch(fa_sim *s) {
  const double *g = s->full + FA_NX;
  int changed = 0, breakaway = -1;
  double worst = 0;
  for (int k = 0; k < FA_NF + FA_NS; k++) {
    const double above = g[2 * k], below = g[2 * k + 1];
    if (!(above > 0) && !(below > 0)) continue;
    if (s->m[k] != 0) {
      if (k < FA_NF) {
        s->x[FA_NQ + fa_stick_coordinate[k]] = 0;
        FA_ON_STOP(s, fa_stick_coordinate[k]);
      }
      fa_set_mode(s, k, 0);
      changed = 1;
    } else if (k < FA_NF) {
      const double excess = above > below ? above : below;
      if (excess > worst) { worst = excess; breakaway = k; }
    } else {
      fa_set_mode(s, k, above > 0 ? 1 : -1);
      changed = 1;
    }
  }
  if (!changed && breakaway >= 0) {
    fa_set_mode(s, breakaway, g[2 * breakaway] > 0 ? 1 : -1);
    changed = 1;
  }
  if (changed) fa_modes_changed(s);
  return changed;
}

/* Bring the modes into agreement with the state, inputs and memories. Leaves s->full up to date. */
static int fa_settle(fa_sim *s) {
  for (int turn = 0; turn < 4 * FA_NM + 20; turn++) {
    fa_evaluate(s);
    if (!fa_switch(s)) return s->status;
    s->events++;
  }
  for (int k = 0; k < FA_NF + FA_NS; k++)
    if (s->full[FA_NX + 2 * k] > 0 || s->full[FA_NX + 2 * k + 1] > 0) s->culprit = k;
  return s->status = FA_NO_MODE;
}

static int fa_time_events(fa_sim *s) {
  int happened = 0;
  for (int k = 0; k < FA_NT; k++)
    for (int n = 0; s->next[k] <= s->t + FA_SNAP * fmax(1, fabs(s->t)); n++) {
      if (n > FA_EVENTS_PER_STEP) { s->culprit = FA_NF + FA_NS + k; return s->status = FA_CHATTER; }
      fa_set_mode(s, FA_NF + FA_NS + k, s->m[FA_NF + FA_NS + k] + 1);
      fa_modes_changed(s);
      s->events++;
      happened = 1;
    }
  return happened;
}

/* Move each table's cursor to the knot that holds at s->t. */
static int fa_table_knots(fa_sim *s) {
  int moved = 0;
  const double now = s->t + FA_SNAP * fmax(1, fabs(s->t));
  for (int i = 0; i < FA_NW; i++) {
    const int n = fa_table_length[i];
    const double *t = fa_table_t[i], *v = fa_table_v[i];
    int c = s->cursor[i];
    while (c + 1 < n && t[c + 1] <= now) c++;
    if (c == s->cursor[i]) continue;
    moved = 1;
    s->cursor[i] = c;
    const int at = c < 0 ? 0 : c;
    const int inside = c >= 0 && c + 1 < n && fa_table_linear[i];
    s->base[FA_NU + i] = v[at];
    s->slope[FA_NU + i] = inside ? (v[at + 1] - v[at]) / (t[at + 1] - t[at]) : 0;
    s->from[FA_NU + i] = t[at];
  }
  return moved;
}

/* The next instant that must be hit; *event is its time event, or -1. */
static double fa_next_knot(const fa_sim *s, int *event) {
  double next = HUGE_VAL;
  *event = -1;
  for (int i = 0; i < FA_NW; i++)
    if (s->cursor[i] + 1 < fa_table_length[i] && fa_table_t[i][s->cursor[i] + 1] < next)
      next = fa_table_t[i][s->cursor[i] + 1];
  for (int k = 0; k < FA_NT; k++)
    if (s->next[k] < next) { next = s->next[k]; *event = k; }
  return next;
}

/* -- delay lines ----------------------------------------------------------------------------------------------- */

#ifdef FA_LINES
#ifdef FA_STAGED
#define FA_STAGE(s, i) ((int)(s)->stage[i])
#else
#define FA_STAGE(s, i) fa_read_stage[i]
#endif
/* Where the value is that entered line l at the last instant (k = 1), the one before it (k = 2), ...; in the ring
 * whatever s->newest holds, which may come from a file. */
static int fa_line_place(const fa_sim *s, int l, int k) {
  return fa_line_first[l] + (int)(((unsigned)s->newest[l] + (unsigned)(k - 1)) % (unsigned)fa_line_size[l]);
}

static void fa_line_fill(fa_sim *s) {
  double start[FA_SIZE(FA_NL)];
  fa_line_start(s->t, s->x, s->base, s->d, s->m, s->p, s->cp, s->cm, 0, start);
  for (int l = 0; l < FA_NL; l++) {
    s->newest[l] = 0;
    for (int k = 0; k < fa_line_size[l]; k++) s->line[fa_line_first[l] + k] = start[l];
  }
}

static void fa_line_push(fa_sim *s, const double *fire, const double *value) {
  for (int l = 0; l < FA_NL; l++) {
    if (fire[fa_line_clock[l]] == 0) continue;
    const int place = fa_line_place(s, l, fa_line_size[l]); /* that of the oldest */
    s->newest[l] = place - fa_line_first[l];
    s->line[place] = value[l];
  }
}
#endif

/* -- one step ------------------------------------------------------------------------------------------------- */

/* Over the states; written out where that leaves the rates in registers. As a loop over vectors it reads in one go what
 * was just written one by one, and waits until that has reached the cache. */
#if defined(__clang__) && !defined(FA_BYTECODE)
#if FA_NX <= 24
#define FA_EACH_STATE(i) _Pragma("clang loop unroll(full)") for (int i = 0; i < FA_NX; i++)
#endif
#endif
#ifndef FA_EACH_STATE
#define FA_EACH_STATE(i) _Pragma("clang loop vectorize(disable) unroll(disable)") for (int i = 0; i < FA_NX; i++)
#endif

typedef struct {
  double h, x[FA_ROOM(FA_NX)], guards[FA_ROOM(FA_NG)];
#ifdef FA_HOOKS
  double k[3][FA_ROOM(FA_NX)];                                   /* dx/dt at the second to fourth stage */
#endif
} fa_trial;

/* x after h from the present state, with modes frozen; the derivative at the start is s->full. */
static void fa_rk4(const fa_sim *s, double h, fa_trial *restrict r) {
#ifdef FA_HOOKS
  double *k2 = r->k[0], *k3 = r->k[1], *k4 = r->k[2];
#else
  double k2[FA_SIZE(FA_NX)], k3[FA_SIZE(FA_NX)], k4[FA_SIZE(FA_NX)];
#endif
  double y[FA_SIZE(FA_NX)], u[FA_SIZE(FA_NI)], *x1 = r->x;
  const double *k1 = s->full;
  fa_inputs(s, s->t + h / 2, u);
  FA_EACH_STATE(i) y[i] = s->x[i] + h / 2 * k1[i];
  fa_derivative(s->t + h / 2, y, u, s->d, s->m, s->p, s->cp, s->cm, 0, k2);
  FA_EACH_STATE(i) y[i] = s->x[i] + h / 2 * k2[i];
  fa_derivative(s->t + h / 2, y, u, s->d, s->m, s->p, s->cp, s->cm, 0, k3);
  FA_EACH_STATE(i) y[i] = s->x[i] + h * k3[i];
  fa_inputs(s, s->t + h, u);
  fa_derivative(s->t + h, y, u, s->d, s->m, s->p, s->cp, s->cm, 0, k4);
  FA_EACH_STATE(i) x1[i] = s->x[i] + h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
}

static void fa_try_step(const fa_sim *s, double h, fa_trial *r) {
  double u[FA_SIZE(FA_NI)];
  r->h = h;
  fa_rk4(s, h, r);
  if (!FA_NG) return;
  fa_inputs(s, s->t + h, u);
  fa_guards(s->t + h, r->x, u, s->d, s->m, s->p, s->cp, s->cm, 0, r->guards);
}

static double fa_worst_guard(const fa_sim *s, const double *guards, int *which) {
  (void)s;
  double worst = -HUGE_VAL;
  for (int k = 0; k < FA_NG; k++)
    if (guards[k] > worst) { worst = guards[k]; *which = k; }
  return worst;
}

/* Shorten the trial b, which violates a guard, to the instant of the first violation: Illinois' rule on the guard that
 * is worst at the end, bisection where it stalls, until the bracket is 1e-13 of the step. b stays on the far side, unless
 * a friction stops its joint within that bracket from the start: speeds are straight lines over so short a time, and the
 * far side of one that falls at 1e300 m/s2 is out of all proportion, so that the state is the one where the line is zero. */
static void fa_locate(const fa_sim *s, double whole, fa_trial *b) {
  fa_trial c;
  double a = 0, fa, fb, wa = 1, wb = 1;
  int which = 0, side = 0;
  fb = fa_worst_guard(s, b->guards, &which);
  fa = s->full[FA_NX + which];
  const double tolerance = 1e-13 * whole;
  for (int turn = 0; turn < 120 && b->h - a > tolerance; turn++) {
    const double width = b->h - a, denominator = wb * fb - wa * fa;
    double h = denominator > 0 && turn % 4 != 3 && fa < 0 ? a - wa * fa * width / denominator : a + width / 2;
    if (h <= a + tolerance / 2) h = a + tolerance / 2;
    if (h >= b->h - tolerance / 2) h = b->h - tolerance / 2;
    int guard = 0;
    fa_try_step(s, h, &c);
    const double worst = fa_worst_guard(s, c.guards, &guard);
    if (worst > 0) {
      *b = c;
      if (guard != which) { which = guard; fa = s->full[FA_NX + which]; wa = wb = 1; side = 0; }
      fb = worst;
      wb = 1;
      wa = side > 0 ? wa / 2 : 1;
      side = 1;
    } else {
      a = h;
      fa = c.guards[which];
      wa = 1;
      wb = side < 0 ? wb / 2 : 1;
      side = -1;
    }
  }
  if (FA_NF && a == 0 && which < 2 * FA_NF && fa < 0 && b->h <= tolerance)
    for (int i = 0; i < FA_NX; i++) b->x[i] = s->x[i] + (b->x[i] - s->x[i]) * (fa / (fa - fb));
}

static int fa_not_finite(fa_sim *s) {
  s->culprit = 0;
  for (int i = 2 * FA_NX - 1; i >= 0; i--) { /* the first state that is not finite; else the first such rate */
    const double value = i < FA_NX ? s->x[i] : s->full[i - FA_NX];
    if (!(value - value == 0)) s->culprit = i < FA_NX ? i : i - FA_NX;
  }
  return s->status = FA_NOT_FINITE;
}

/* See that s->full holds dx/dt at s->t. */
static int fa_update_derivative(fa_sim *s) {
  if (s->rated) return FA_OK;
  double u[FA_SIZE(FA_NI)];
  fa_inputs(s, s->t, u);
  fa_derivative(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, 0, s->full);
  s->rated = 1;
  return fa_finite(s->full, FA_NX) ? FA_OK : fa_not_finite(s);
}

/* Take over the trial; dx/dt at its end is left for when it is needed, since memories may change before. */
static void fa_accept(fa_sim *s, const fa_trial *b) {
  for (int i = 0; i < FA_NX; i++) *(volatile double *)(s->x + i) = b->x[i];
  for (int i = 0; i < FA_NG; i++) *(volatile double *)(s->full + FA_NX + i) = b->guards[i];
  s->rated = 0;
}

/* One step of length h, split at the switches inside it. Needs the guards in s->full at s->t; leaves them there. */
static int fa_step(fa_sim *s, double h) {
  const double end = s->t + h;
  fa_trial b;
  for (int events = 0; events <= FA_EVENTS_PER_STEP; events++) {
    int which = 0;
    if (fa_update_derivative(s)) return s->status;
#ifdef FA_ADAPTIVE
    if (s->ready) b = *(const fa_trial *)s->ready;
    else
#endif
    fa_try_step(s, end - s->t, &b);
#ifdef FA_ADAPTIVE
    s->ready = 0;
#endif
    if (!(fa_worst_guard(s, b.guards, &which) > 0)) {
      FA_ON_STEP(s, &b, -1);
      fa_accept(s, &b);
      s->t = end;
      s->steps++;
      return fa_finite(s->x, FA_NX) && fa_finite(b.guards, FA_NG) ? FA_OK : fa_not_finite(s);
    }
    fa_locate(s, h, &b);
    fa_worst_guard(s, b.guards, &which);
    FA_ON_STEP(s, &b, which);
    fa_accept(s, &b);
    s->t = end - s->t - b.h > 1e-13 * h ? s->t + b.h : end;
    if (!fa_finite(s->x, FA_NX)) return fa_not_finite(s);
#ifdef FA_PAUSABLE
    if (s->pausing && b.h > 1e-3 * h) { s->paused = 1; return FA_OK; } /* closer ones are one event to the caller */
#endif
    fa_switch(s);
    s->events++;
    if (fa_settle(s)) return s->status;
    if (s->t == end) {
      FA_ON_STEP(s, 0, -1);
      s->steps++;
      return FA_OK;
    }
    s->culprit = which / 2;
  }
  return s->status = FA_CHATTER;
}

/* -- runs ----------------------------------------------------------------------------------------------------- */

/* Start at s->t with s->x, s->d, s->p and s->m set; frictions whose mode is not finite start stuck or sliding as their
 * speed says, other such modes start at 0. */
static int fa_start(fa_sim *s) {
  for (int k = 0; k < FA_NM; k++)
    if (!(s->m[k] - s->m[k] == 0)) {
      const double v = k < FA_NF ? s->x[FA_NQ + fa_stick_coordinate[k]] : 0;
      s->m[k] = (double)((v > 0) - (v < 0));
    }
  for (int i = 0; i < FA_NW; i++) {
    s->cursor[i] = -1;
    s->base[FA_NU + i] = fa_table_v[i][0];
    s->slope[FA_NU + i] = s->from[FA_NU + i] = 0;
  }
  fa_parameters_changed(s);
#ifdef FA_LINES
  fa_line_fill(s);
#endif
  fa_table_knots(s);
  if (fa_time_events(s) && s->status) return s->status;
  if (fa_settle(s)) return s->status;
  return fa_finite(s->full, FA_NX) ? FA_OK : fa_not_finite(s);
}

#ifdef FA_ADAPTIVE
/* Error of a step, x1 its end and e its estimate, over what is allowed. */
static double fa_step_error(const fa_sim *s, const double *x1, const double *e);

/* Take steps to `target` whose estimated errors are allowed. The estimate is h / 6 (k4 - f(end)): give the weight of k4 to
 * a fifth stage f(end), which stands at t + h too and sees x to the same order, and the conditions for order 3 still hold,
 * those for order 4 do not. */
static int fa_adapt(fa_sim *s, double target) {
  const double shortest = 1e-9 * s->hmax + 4 * 2.220446049250313e-16 * fabs(target);
  double e[FA_SIZE(FA_NX)], last[FA_SIZE(FA_NX)], y[FA_SIZE(FA_NX)], k[FA_SIZE(FA_NX)], u[FA_SIZE(FA_NI)];
  fa_trial b;
  while (s->t < target) {
    const double left = target - s->t;
    const int ends = s->h >= left * (1 - 1e-9);
    const double h = ends ? left : s->h > left / 2 ? left / 2 : s->h, to = ends ? target : s->t + h;
    if (fa_update_derivative(s)) return s->status;
    fa_inputs(s, s->t + h / 2, u);
    for (int i = 0; i < FA_NX; i++) y[i] = s->x[i] + h / 2 * s->full[i];
    fa_derivative(s->t + h / 2, y, u, s->d, s->m, s->p, s->cp, s->cm, 0, k);
    for (int i = 0; i < FA_NX; i++) e[i] = s->full[i] + 2 * k[i], y[i] = s->x[i] + h / 2 * k[i];
    fa_derivative(s->t + h / 2, y, u, s->d, s->m, s->p, s->cp, s->cm, 0, k);
    for (int i = 0; i < FA_NX; i++) e[i] += 2 * k[i], y[i] = s->x[i] + h * k[i];
    fa_inputs(s, s->t + h, u);
    fa_derivative(s->t + h, y, u, s->d, s->m, s->p, s->cp, s->cm, 0, last);
    for (int i = 0; i < FA_NX; i++) b.x[i] = s->x[i] + h / 6 * (e[i] + last[i]);
    fa_derivative(s->t + h, b.x, u, s->d, s->m, s->p, s->cp, s->cm, 0, k);
    for (int i = 0; i < FA_NX; i++) e[i] = h / 6 * (last[i] - k[i]);
    const double error = fa_step_error(s, b.x, e);
    const double factor = error > 0 ? 0.9 * pow(error, -0.25) : error == 0 ? 5 : 0.2;   /* the last if not finite */
    if (!(error <= 1) && h > shortest) { s->h = fmax(h * fmin(fmax(factor, 0.2), 0.9), shortest); continue; }
    b.h = h;
    if (FA_NG) fa_guards(s->t + h, b.x, u, s->d, s->m, s->p, s->cp, s->cm, 0, b.guards);
    s->ready = &b;
    const int failed = fa_step(s, h);
    s->ready = 0;
    if (failed) return s->status;
#ifdef FA_PAUSABLE
    if (s->paused) return FA_OK;
#endif
    s->t = to;
    if (!ends || factor < 1) s->h = h * fmin(fmax(factor, 0.2), 5);   /* a step cut short by its target tells too little */
    else s->h = fmax(s->h, fmin(h * fmin(factor, 5), 5 * s->h));
  }
  return FA_OK;
}
#endif

#if defined(__clang__) || defined(__GNUC__)
#define FA_LIKELY(condition) __builtin_expect(condition, 1) /* a branch, which is foretold; a choice would be waited for */
#define FA_CALLED static __attribute__((noinline))
#else
#define FA_LIKELY(condition) (condition)
#define FA_CALLED static
#endif

/* Calls, so that their divisions are carried out where there are several parts, rather than beforehand to be chosen from:
 * all of a step waits for its length. */
#ifndef FA_ADAPTIVE
FA_CALLED int64_t fa_parts(double span, double hmax) {
  return (int64_t)ceil(span / hmax * (1 - 1e-9));
}

FA_CALLED double fa_on_the_way(double start, double span, int64_t i, int64_t n) {
  return start + span * ((double)i / (double)n);
}
#endif

/* Integrate to t_end, hitting every knot and time event on the way. Needs s->full; leaves its guards alone up to date. */
static int fa_integrate_to(fa_sim *s, double t_end) {
  while (s->t < t_end) {
    int event;
    double target = fa_next_knot(s, &event);
    if (FA_LIKELY(target > t_end - FA_SNAP * fmax(1, fabs(t_end)))) {
      if (target > t_end + FA_SNAP * fmax(1, fabs(t_end))) event = -1;
      target = t_end;
    }
#ifdef FA_ADAPTIVE
    if (fa_adapt(s, target)) return s->status;
#else
    const double start = s->t, span = target - start;
    const int64_t n = FA_LIKELY(!(span * (1 - 1e-9) > s->hmax)) ? 1 : fa_parts(span, s->hmax);
    for (int64_t i = 1; i <= n; i++) {
      const double to = i < n ? fa_on_the_way(start, span, i, n) : target;
#ifdef FA_CANCELLABLE
      if (s->cancel && *s->cancel) return s->status = FA_CANCELLED;
#endif
      FA_ON_TARGET(s, event, i, n);
      if (fa_step(s, to - s->t)) return s->status;
#ifdef FA_PAUSABLE
      if (s->paused) return FA_OK;
#endif
      s->t = to;
    }
#endif
#ifdef FA_PAUSABLE
    if (s->paused) return FA_OK;
    if (s->pausing && fa_next_knot(s, &event) <= s->t + FA_SNAP * fmax(1, fabs(s->t))) {
      s->paused = 1;
      return FA_OK;
    }
#endif
    const int knots = fa_table_knots(s), events = FA_NT ? fa_time_events(s) : 0;
    if (s->status) return s->status;
    if ((knots || events) && fa_settle(s)) return s->status;
  }
  return FA_OK;
}

/* The same, leaving all of s->full up to date. */
static int fa_integrate(fa_sim *s, double t_end) {
  return fa_integrate_to(s, t_end) || fa_update_derivative(s) ? s->status : FA_OK;
}

/* Let the clocks flagged in fire tick: memories take their new values and the guards are checked again. */
static int fa_tick(fa_sim *s, const double *flags) {
  double u[FA_SIZE(FA_NI)], d[FA_SIZE(FA_ND)];
  fa_inputs(s, s->t, u);
#ifdef FA_LINES
  double fire[FA_SIZE(FA_NC + FA_NEO + FA_NLR)], value[FA_SIZE(FA_NL)];
  memcpy(fire, flags, sizeof(double) * (FA_NC + FA_NEO));
  for (int i = 0; i < FA_NLR; i++)
    fire[FA_NC + FA_NEO + i] = s->line[fa_line_place(s, fa_read_line[i], FA_STAGE(s, i))];
#else
  const double *fire = flags;
#endif
  FA_ON_TICK(s, fire);
  fa_update(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, fire, d);
#ifdef FA_LINES
  fa_entering(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, fire, value);
  fa_line_push(s, fire, value);
#endif
  for (int i = 0; i < FA_ND; i++) s->d[i] = d[i];
  return fa_settle(s);
}

static void fa_read_outputs(const fa_sim *s, double *y) {
  double u[FA_SIZE(FA_NI)];
  fa_inputs(s, s->t, u);
  fa_outputs(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, 0, y);
}
