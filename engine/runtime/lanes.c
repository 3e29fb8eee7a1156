/* Several runs together, one in each lane of vectors; included after simulate.c. They share the instants of rows, clocks and
 * knots. What most steps are is done in all lanes at once: a step, a sample instant, a row. A lane in which anything else
 * happens, such as a switch, is done by the functions for one run, from its own state before, and then goes on with the
 * others: all stand at the same instants. Each lane carries out the operations of a single run in their order.
 *
 * In byte code all of a run's file is wide, for modes and parameters differ between lanes; a lane alone has a file of its own. */

#if FA_WIDTH > 1

typedef struct {
  double t;                                                      /* time of x, in every lane */
#ifdef FA_BYTECODE
  const fa_code *code;
  fa_lane *wide, *d, *m;                                         /* as the file of one run; where d and m lie in it */
#else
  fa_lane d[FA_SIZE(FA_ND)], m[FA_SIZE(FA_NM)], p[FA_SIZE(FA_NP)], cp[FA_SIZE(FA_NCP)], cm[FA_SIZE(FA_NCM)];
#endif
  fa_lane x[FA_ROOM(FA_NX)], base[FA_ROOM(FA_NI)], slope[FA_ROOM(FA_NI)], from[FA_ROOM(FA_NI)];
  fa_lane full[FA_ROOM(FA_NX) + FA_ROOM(FA_NG)];                 /* dx/dt and guards at t */
  fa_mask rated;                                                 /* lanes whose dx/dt in full is that at t */
  fa_mask on;                                                    /* lanes whose run goes on */
  fa_mask steps;                                                 /* taken here; those of lanes alone are in run */
  fa_lane hmax, knot;                                            /* longest step; next knot or time event */
  fa_job *job[FA_WIDTH];
  fa_sim run[FA_WIDTH];                                          /* the rest of each; its t, x, d, full while it is alone */
} fa_lanes;

#ifdef FA_BYTECODE
#undef FA_CODE
#define FA_CODE L->code

static void fa_evaluate_lanes(const fa_lanes *L, int which, fa_lane t, const fa_lane *x, const fa_lane *u, const fa_lane *fire,
                              fa_lane *r) {
  const fa_code *code = L->code;
  fa_lane *wide = L->wide;
  wide[0] = t;
  for (int64_t i = 0; i < code->nx; i++) wide[FA_X + i] = x[i];
  for (int64_t i = 0; i < code->nu + code->nw; i++) wide[FA_U + i] = u[i];
  if (fire) for (int64_t i = 0; i < code->nc; i++) wide[FA_FIRE + i] = fire[i];
  code->program[which].lanes(wide, 0, 0, r, fa_bits);
}
#define fa_derivative_lanes(t, x, u, d, m, p, cp, cm, fire, r) fa_evaluate_lanes(L, FA_DERIVATIVE, t, x, u, fire, r)
#define fa_guards_lanes(t, x, u, d, m, p, cp, cm, fire, r) fa_evaluate_lanes(L, FA_GUARDS, t, x, u, fire, r)
#define fa_full_lanes(t, x, u, d, m, p, cp, cm, fire, r) fa_evaluate_lanes(L, FA_FULL, t, x, u, fire, r)
#define fa_outputs_lanes(t, x, u, d, m, p, cp, cm, fire, r) fa_evaluate_lanes(L, FA_OUTPUTS, t, x, u, fire, r)
#define fa_update_lanes(t, x, u, d, m, p, cp, cm, fire, r) fa_evaluate_lanes(L, FA_UPDATE, t, x, u, fire, r)
#endif

/* Let one lane's run be continued alone ... */
static fa_sim *fa_alone(fa_lanes *L, int l) {
  fa_sim *s = L->run + l;
  s->t = L->t;
  for (int i = 0; i < FA_NX; i++) s->x[i] = L->x[i][l];
  for (int i = 0; i < FA_ND; i++) s->d[i] = L->d[i][l];
  for (int i = 0; i < FA_NX + FA_NG; i++) s->full[i] = L->full[i][l];
  s->rated = L->rated[l] != 0;
  return s;
}

/* The end of one lane's run, which was alone. */
static void fa_end(fa_lanes *L, int l) {
  fa_sim *s = L->run + l;
  s->steps += L->steps[l];
  fa_give(s, L->job[l]);
  L->on[l] = 0;
}

/* Inputs as each lane has them, put together in registers: what is written one by one cannot be read in one go at once. */
static void fa_join_inputs(fa_lanes *L) {
  for (int i = 0; i < FA_NI; i++) {
    fa_lane base, slope, from;
    FA_EACH_LANE(l) base[l] = L->run[l].base[i], slope[l] = L->run[l].slope[i], from[l] = L->run[l].from[i];
    L->base[i] = base, L->slope[i] = slope, L->from[i] = from;
  }
}

/* Parameters of one lane, and what is prepared from them; in byte code all of its file. */
static void fa_join_parameters(fa_lanes *L, int l) {
  const fa_sim *s = L->run + l;
#ifdef FA_BYTECODE
  for (int64_t k = 0; k < L->code->registers; k++) L->wide[k][l] = s->file[k];
#else
  for (int i = 0; i < FA_NP; i++) L->p[i][l] = s->p[i];
  for (int i = 0; i < FA_NCP; i++) L->cp[i][l] = s->cp[i];
#endif
}

/* Modes of one lane, and what is prepared from them. */
static void fa_join_modes(fa_lanes *L, int l) {
  const fa_sim *s = L->run + l;
#ifdef FA_BYTECODE
  int changed = 0;
  for (int i = 0; i < FA_NM; i++) {
    const double before = L->m[i][l];
    changed |= memcmp(&before, s->m + i, sizeof before);
  }
  if (!changed) return;
  for (const fa_instruction *c = L->code->program[FA_MODES].instructions; c->operation != FA_AT_END; c++)
    L->wide[c->to][l] = s->file[c->to];
#else
  for (int i = 0; i < FA_NCM; i++) L->cm[i][l] = s->cm[i];
#endif
  for (int i = 0; i < FA_NM; i++) L->m[i][l] = s->m[i];
}

/* ... and take what it has become back among the others; it ends here if it has failed. */
static void fa_join(fa_lanes *L, int l) {
  const fa_sim *s = L->run + l;
  int event;
  for (int i = 0; i < FA_NX; i++) L->x[i][l] = s->x[i];
  for (int i = 0; i < FA_ND; i++) L->d[i][l] = s->d[i];
  fa_join_modes(L, l);
  for (int i = 0; i < FA_NX + FA_NG; i++) L->full[i][l] = s->full[i];
  if (FA_NW) fa_join_inputs(L);
  L->rated[l] = s->rated ? -1 : 0;
  L->knot[l] = fa_next_knot(s, &event);
  if (s->status) fa_end(L, l);
}

static void fa_lanes_inputs(const fa_lanes *L, double t, fa_lane *u) {
  for (int i = 0; i < FA_NI; i++) u[i] = L->base[i] + L->slope[i] * (t - L->from[i]);
}

#define FA_LANES_CALL(name, t, x, u, fire, r) fa_##name##_lanes(FA_ALL(t), x, u, L->d, L->m, L->p, L->cp, L->cm, fire, r)

static fa_mask fa_lanes_violated(const fa_lanes *L, const fa_lane *guards) {
  (void)L;
  fa_mask found = {0};
  for (int k = 0; k < FA_NG; k++) found |= guards[k] > 0;
  return found;
}

static fa_mask fa_lanes_not_finite(const fa_lane *a, int n) {
  fa_mask found = {0};
  for (int i = 0; i < n; i++) found |= a[i] - a[i] != 0;
  return found;
}

/* What fa_settle does, in all lanes whose run goes on. */
static void fa_lanes_settle(fa_lanes *L) {
  fa_lane u[FA_SIZE(FA_NI)];
  fa_lanes_inputs(L, L->t, u);
  FA_LANES_CALL(full, L->t, L->x, u, 0, L->full);
  L->rated = (fa_mask){0} == 0;
  const fa_mask apart = fa_lanes_violated(L, L->full + FA_NX) & L->on;
  if (fa_any(apart)) FA_EACH_LANE(l) if (apart[l]) {
    fa_settle(fa_alone(L, l));
    fa_join(L, l);
  }
}

/* What fa_step does. */
static void fa_lanes_step(fa_lanes *L, double h) {
  const double t = L->t;
  fa_lane k2[FA_SIZE(FA_NX)], k3[FA_SIZE(FA_NX)], k4[FA_SIZE(FA_NX)], y[FA_SIZE(FA_NX)], u[FA_SIZE(FA_NI)];
  fa_lane guards[FA_SIZE(FA_NG)], *k1 = L->full;
  const fa_mask rated = L->rated;
  fa_mask apart = {0};
  if (fa_any(~rated)) {
    fa_lanes_inputs(L, t, u);
    FA_LANES_CALL(derivative, t, L->x, u, 0, k1);
    apart = fa_lanes_not_finite(k1, FA_NX) & ~rated;
  }
  fa_lanes_inputs(L, t + h / 2, u);
  FA_EACH_STATE(i) y[i] = L->x[i] + h / 2 * k1[i];
  FA_LANES_CALL(derivative, t + h / 2, y, u, 0, k2);
  FA_EACH_STATE(i) y[i] = L->x[i] + h / 2 * k2[i];
  FA_LANES_CALL(derivative, t + h / 2, y, u, 0, k3);
  FA_EACH_STATE(i) y[i] = L->x[i] + h * k3[i];
  fa_lanes_inputs(L, t + h, u);
  FA_LANES_CALL(derivative, t + h, y, u, 0, k4);
  FA_EACH_STATE(i) y[i] = L->x[i] + h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
  apart |= fa_lanes_not_finite(y, FA_NX);
  if (FA_NG) {
    FA_LANES_CALL(guards, t + h, y, u, 0, guards);
    apart |= fa_lanes_violated(L, guards) | fa_lanes_not_finite(guards, FA_NG);
  }
  apart &= L->on;
  const int any = fa_any(apart);
  if (any) {
    L->rated = rated;
    FA_EACH_LANE(l) if (apart[l]) fa_alone(L, l);
  }
  memcpy(L->x, y, sizeof(fa_lane) * FA_NX);
  memcpy(L->full + FA_NX, guards, sizeof(fa_lane) * FA_NG);
  L->rated = (fa_mask){0};
  L->steps -= L->on & ~apart;
  if (any) FA_EACH_LANE(l) if (apart[l]) {
    fa_step(L->run + l, h);
    fa_join(L, l);
  }
}

/* Lanes that take as many steps over a span as the first that is on; their number is n. See fa_integrate_to. */
static fa_mask fa_lanes_alike(const fa_lanes *L, double span, int64_t *n) {
  const fa_mask one = ~(FA_ALL(span * (1 - 1e-9)) > L->hmax);
  int first = 0;
  while (!L->on[first]) first++;
  *n = one[first] ? 1 : fa_parts(span, L->hmax[first]);
  if (*n == 1 && !fa_any(~one)) return one;
  const fa_lane parts = span / L->hmax * (1 - 1e-9);
  return (one & (FA_ALL((double)*n) == 1)) | (~one & (parts > (double)(*n - 1)) & (parts <= (double)*n));
}

/* What fa_integrate_to does. A lane that meets a knot or time event on the way, or takes other steps, goes there alone. */
static void fa_lanes_to(fa_lanes *L, double t_end) {
  const double start = L->t, span = t_end - start, close = FA_SNAP * fmax(1, fabs(t_end));
  if (!(start < t_end)) return;
  int64_t n;
  const fa_mask apart = L->on & (~fa_lanes_alike(L, span, &n) | ~(L->knot > t_end - close));
  const int any = fa_any(apart);
  if (any) FA_EACH_LANE(l) if (apart[l]) {
    fa_integrate_to(fa_alone(L, l), t_end);
    L->on[l] = 0;
  }
  for (int64_t i = 1; i <= n; i++) {
    const double to = i < n ? fa_on_the_way(start, span, i, n) : t_end;
    if (L->run[0].cancel && *L->run[0].cancel) FA_EACH_LANE(l) if (L->on[l]) {
      fa_alone(L, l)->status = FA_CANCELLED;
      fa_end(L, l);
    }
    if (!fa_any(L->on)) break;
    fa_lanes_step(L, to - L->t);
    L->t = to;
  }
  L->t = t_end;
  if (any) FA_EACH_LANE(l) if (apart[l]) {
    L->on[l] = -1;
    fa_join(L, l);
  }
  const fa_mask due = L->on & ~apart & (L->knot <= t_end + close);
  if (fa_any(due)) FA_EACH_LANE(l) if (due[l]) {
    fa_sim *s = fa_alone(L, l);
    const int knots = fa_table_knots(s), events = FA_NT ? fa_time_events(s) : 0;
    if (!s->status && (knots || events)) fa_settle(s);
    fa_join(L, l);
  }
}

/* Let the clocks flagged in fire tick. What enters and leaves delay lines is each lane's own. */
static void fa_lanes_tick(fa_lanes *L, const double *flags) {
  if (FA_NL) {
    FA_EACH_LANE(l) if (L->on[l]) {
      fa_tick(fa_alone(L, l), flags);
      fa_join(L, l);
    }
    return;
  }
  fa_lane u[FA_SIZE(FA_NI)], d[FA_SIZE(FA_ND)], fire[FA_SIZE(FA_NC)];
  for (int c = 0; c < FA_NC; c++) fire[c] = FA_ALL(flags[c]);
  fa_lanes_inputs(L, L->t, u);
  FA_LANES_CALL(update, L->t, L->x, u, fire, d);
  memcpy(L->d, d, sizeof(fa_lane) * FA_ND);
  fa_lanes_settle(L);
}

static void fa_lanes_record(fa_lanes *L, int64_t row) {
  fa_lane u[FA_SIZE(FA_NI)], y[FA_SIZE(FA_NY)];
  fa_lanes_inputs(L, L->t, u);
  FA_LANES_CALL(outputs, L->t, L->x, u, 0, y);
  FA_EACH_LANE(l) if (L->on[l]) {
    double *to = L->job[l]->y + row * FA_NY;
    for (int i = 0; i < FA_NY; i++) to[i] = y[i][l];
    L->job[l]->row = row + 1;
  }
}

/* Begin one run, alone, up to its first row. */
static void fa_lanes_begin(fa_lanes *L, int l, int64_t *knot, int64_t *due) {
  fa_job *job = L->job[l];
  fa_sim *s = L->run + l;
  fa_take(s, job);
  for (int c = 0; c < FA_NC; c++) due[c] = job->offset[c];
  *knot = 0;
  if (FA_NU) while (*knot < job->knots && job->knot[*knot] <= 0) fa_drive_inputs(s, job, (*knot)++);
  if (!fa_start(s) && !fa_clocks(s, job, 0, due)) fa_record(s, job, 0);
  L->t = s->t;
  L->hmax[l] = s->hmax;
  fa_join_parameters(L, l);
  fa_join_inputs(L);
  fa_join(L, l);
}

/* What fa_run does. */
static void fa_lanes_run(fa_lanes *L) {
  const fa_job *job = L->job[0];
  const int64_t last = job->rows[job->outputs];
  int64_t tick = 0, knot = 0, row = 0, due[FA_SIZE(FA_NC)];
  FA_EACH_LANE(l) if (L->on[l]) fa_lanes_begin(L, l, &knot, due);
  while (tick < last && fa_any(L->on)) {
    tick = fa_next_tick(L->run, job, row, knot, due);
    fa_lanes_to(L, job->t0 + (double)tick * job->resolution);
    int driven = 0;
    for (; FA_NU && knot < job->knots && job->knot[knot] <= tick; knot++, driven = 1)
      FA_EACH_LANE(l) if (L->on[l]) {
        L->run[l].t = L->t;
        fa_drive_inputs(L->run + l, L->job[l], knot);
      }
    if (driven) {
      fa_join_inputs(L);
      fa_lanes_settle(L);
    }
    double fire[FA_SIZE(FA_NC)];
    int any = 0;
    for (int c = 0; c < FA_NC; c++) {
      fire[c] = due[c] == tick;
      if (due[c] == tick) due[c] += job->period[c], any = 1;
    }
    if (any) fa_lanes_tick(L, fire);
    if (tick == job->rows[row + 1]) fa_lanes_record(L, ++row);
  }
  FA_EACH_LANE(l) if (L->on[l]) {
    fa_update_derivative(fa_alone(L, l));
    fa_end(L, l);
  }
}

/* Carry out runs that share rows, clocks, knots and the flag that ends them, at most as many as vectors have lanes. */
FA_EXPORT void fa_simulate_lanes(fa_job *const *jobs, int64_t count) {
  static _Thread_local fa_lanes lanes;
  fa_lanes *L = &lanes;
  memset(L, 0, (size_t)((char *)L->run - (char *)L));
  FA_EACH_LANE(l) fa_clear(L->run + l);
#ifdef FA_BYTECODE
  const fa_code *code = L->code = jobs[0]->code;
  fa_lane wide[code->registers];
  double file[FA_WIDTH][code->registers];
  memset(wide, 0, sizeof wide);
  L->wide = wide, L->d = wide + FA_D, L->m = wide + FA_M;
  for (int l = 0; l < count; l++) L->run[l].code = code, L->run[l].file = fa_filled(code, file[l]);
#endif
  for (int l = 0; l < count; l++) {
    L->job[l] = jobs[l];
    L->on[l] = -1;
  }
  fa_lanes_run(L);
}
#endif

/* How many runs at a time; fewer than two if the processor has no vectors for that. */
FA_EXPORT int64_t fa_lanes_width(void) { return FA_WIDTH; }
