/* The rules announced in tangent.c; included after simulate.c and the generated fa_NAME_tangent, which carry seeds
 * through the Jacobian of a function of the model: out = J [S | dt | slope dt | D] + the parameters' own columns. What
 * several rates share comes after them in out, FA_SHARED rows; see engine/sharing.py. */

typedef struct {
  fa_columns S[FA_ROOM(FA_NX)];             /* states */
  fa_columns D[FA_ROOM(FA_ND)];             /* memories */
  fa_columns dt, aim;                       /* of the present time, of the step's end */
  fa_columns begin, goal;                   /* of the segment's start and end, which several steps may divide */
  int moving;                               /* whether any of these is not zero */
  double *rows;                             /* output tangents, (direction, row, output) */
  int64_t height;                           /* how many rows */
  double least;                             /* smallest |g_x Phi_h + g_t| met, relative; small means grazing */
  fa_columns line[FA_ROOM_LINE];            /* values in the delay lines; last, for it is large and seldom used */
} fa_tangents;

/* The Jacobian of the derivative at the four stages of a step, whose rates are k. The stages are known once the step has been
 * tried, so they are worked out together, in lanes; FA_AT_STAGE is that of one of them. */
#define FA_AT_STAGE(j, a) ((const double *)(j) + (a))
static void fa_jacobians(const fa_sim *s, const double *t, const double (*x)[FA_ROOM(FA_NX)], fa_lane *j) {
  fa_lane time, state[FA_SIZE(FA_NX)], input[FA_SIZE(FA_NI)];
  for (int a = 0; a < FA_WIDTH; a++) time[a] = t[a];
  for (int i = 0; i < FA_NX; i++)
    for (int a = 0; a < FA_WIDTH; a++) state[i][a] = x[a][i];
  for (int i = 0; i < FA_NI; i++) input[i] = s->base[i] + s->slope[i] * (time - s->from[i]);
  fa_derivative_values_lanes(time, state, input, s->d, s->m, s->p, s->cp, s->cm, 0, j);
}

/* Tangent of one RK4 step as it was tried from the present state, into T->S. dh may be NULL. With with_length, column FA_DIRS
 * of T->S becomes Phi_h: its only seed is a unit change of the length; and end receives the state at the end. */
FA_INLINE void fa_tangent_rk4(fa_sim *s, const fa_trial *trial, const fa_lane *dh, int with_length, double *end) {
  static const double part[4] = {0, 0.5, 0.5, 1};
  fa_tangents *T = s->listener;
  const int timed = T->moving || with_length || dh;
  const int lanes = with_length ? FA_LANES : FA_OWN_LANES;
  const double h = trial->h, *k[4] = {s->full, trial->k[0], trial->k[1], trial->k[2]};
  double t[4], x[4][FA_ROOM(FA_NX)];
  fa_columns dk[4][FA_SIZE(FA_NX + FA_SHARED)], y[FA_SIZE(FA_NX)], dt, length;
  fa_lane j[FA_SIZE(FA_DERIVATIVE_NNZ)];
  t[0] = s->t;
  for (int i = 0; i < FA_NX; i++) x[0][i] = s->x[i];
  for (int a = 1; a < 4; a++) {
    t[a] = s->t + part[a] * h;
    for (int i = 0; i < FA_NX; i++) x[a][i] = s->x[i] + part[a] * h * k[a - 1][i];
  }
  fa_jacobians(s, t, x, j);
  FA_EACH_OF(lanes, l) length[l] = dh ? dh[l] : (fa_lane){0};
  if (with_length) FA_COLUMN(length, FA_DIRS) = 1;
  fa_derivative_tangent(s, FA_AT_STAGE(j, 0), T->S, T->D, timed ? T->dt : 0, lanes, dk[0]);
  for (int a = 1; a < 4; a++) {
    const double c = part[a];
    for (int i = 0; i < FA_NX; i++) {
      FA_EACH_OF(lanes, l) y[i][l] = T->S[i][l] + c * h * dk[a - 1][i][l];
      if (timed) FA_EACH_OF(lanes, l) y[i][l] += c * length[l] * k[a - 1][i];
    }
    if (timed) FA_EACH_OF(lanes, l) dt[l] = T->dt[l] + c * length[l];
    fa_derivative_tangent(s, FA_AT_STAGE(j, a), y, T->D, timed ? dt : 0, lanes, dk[a]);
  }
  for (int i = 0; i < FA_NX; i++) {
    FA_EACH_OF(lanes, l) T->S[i][l] += h / 6 * (dk[0][i][l] + 2 * (dk[1][i][l] + dk[2][i][l]) + dk[3][i][l]);
    if (!timed) continue;
    const double mean = (k[0][i] + 2 * (k[1][i] + k[2][i]) + k[3][i]) / 6;
    FA_EACH_OF(lanes, l) T->S[i][l] += length[l] * mean;
    if (with_length) end[i] = s->x[i] + h * mean;
  }
}

static int fa_any_nonzero(const fa_sim *s, const fa_lane *a) {
  (void)s;
  for (int j = 0; j < FA_DIRS; j++) if (FA_COLUMN(a, j) != 0) return 1;
  return 0;
}

static void fa_tangent_target(void *sim, int event, int64_t i, int64_t n) {
  fa_sim *s = sim;
  fa_tangents *T = s->listener;
  if (i == 1) {
    double r[FA_SIZE(FA_FOLLOWING_NNZ)];
    memcpy(T->begin, T->dt, sizeof T->begin);
    memset(T->goal, 0, sizeof T->goal);
    if (event >= 0) {
      fa_following_values(s->t, s->x, s->base, s->d, s->m, s->p, s->cp, s->cm, 0, r);
      for (int k = 0; k < FA_FOLLOWING_NNZ; k++)
        if (fa_following_row[k] == event && fa_following_col[k] >= FA_AT_Q)
          FA_COLUMN(T->goal, fa_following_col[k] - FA_AT_Q) += r[k];
    }
    T->moving = fa_any_nonzero(s, T->begin) || fa_any_nonzero(s, T->goal);
  }
  const double share = (double)i / (double)n;
  FA_EACH(l) T->aim[l] = i == n ? T->goal[l] : T->begin[l] + (T->goal[l] - T->begin[l]) * share;
}

static void fa_tangent_step(void *sim, const void *tried, int guard) {
  fa_sim *s = sim;
  fa_tangents *T = s->listener;
  fa_trial still;
  const fa_trial *trial = tried ? tried : &still;
  if (!tried) fa_try_step(s, 0, &still);
  if (guard < 0) {
    fa_columns dh;
    FA_EACH(l) dh[l] = T->aim[l] - T->dt[l];
    fa_tangent_rk4(s, trial, T->moving ? dh : 0, 0, 0);
    memcpy(T->dt, T->aim, sizeof T->dt);
    return;
  }
  double end[FA_SIZE(FA_NX)], u[FA_SIZE(FA_NI)], j[FA_SIZE(FA_GUARDS_NNZ)], size = 1e-300;
  fa_columns dg[FA_SIZE(FA_NG)], unit;
  fa_tangent_rk4(s, trial, 0, 1, end);
  fa_inputs(s, s->t + trial->h, u);
  fa_guards_values(s->t + trial->h, end, u, s->d, s->m, s->p, s->cp, s->cm, 0, j);
  memcpy(unit, T->dt, sizeof unit);
  FA_COLUMN(unit, FA_DIRS) = 1;
  fa_guards_tangent(s, j, T->S, T->D, unit, FA_LANES, dg);
  for (int k = 0; k < FA_GUARDS_NNZ; k++)
    if (fa_guards_row[k] == guard && fa_guards_col[k] < FA_AT_T)
      size += fabs(j[k] * FA_COLUMN(T->S[fa_guards_col[k]], FA_DIRS));
  const double rate = FA_COLUMN(dg[guard], FA_DIRS);
  if (fabs(rate) / size < T->least) T->least = fabs(rate) / size;
  if (rate != 0) {
    fa_columns later;
    FA_EACH(l) later[l] = -dg[guard][l] / rate;
    FA_COLUMN(later, FA_DIRS) = 0;
    for (int i = 0; i < FA_NX; i++) {
      const double speed = FA_COLUMN(T->S[i], FA_DIRS);
      FA_EACH(l) T->S[i][l] += speed * later[l];
    }
    FA_EACH(l) T->dt[l] += later[l];
    T->moving = 1;
  }
  for (int i = 0; i < FA_NX; i++) FA_COLUMN(T->S[i], FA_DIRS) = 0;
}

static void fa_tangent_stop(void *sim, int coordinate) {
  fa_sim *s = sim;
  fa_tangents *T = s->listener;
  memset(T->S[FA_NQ + coordinate], 0, sizeof(fa_columns));
}

static void fa_tangent_tick(void *sim, const double *fire) {
  fa_sim *s = sim;
  fa_tangents *T = s->listener;
  double u[FA_SIZE(FA_NI)], j[FA_SIZE(FA_UPDATE_NNZ)];
  fa_columns next[FA_SIZE(FA_ND)];
  fa_inputs(s, s->t, u);
  fa_update_values(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, fire, j);
  memset(next, 0, sizeof next);
  fa_update_tangent(s, j, T->S, T->D, 0, FA_OWN_LANES, next);
#ifdef FA_LINES
  double v[FA_SIZE(FA_ENTERING_NNZ)];
  fa_columns entering[FA_SIZE(FA_NL)];
  memset(entering, 0, sizeof entering);
  fa_entering_values(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, fire, v);
  fa_entering_tangent(s, v, T->S, T->D, 0, FA_OWN_LANES, entering);
  for (int i = 0; i < FA_NLR; i++)
    if (fire[fa_line_clock[fa_read_line[i]]] != 0)
      memcpy(next[fa_read_memory[i]], T->line[fa_line_place(s, fa_read_line[i], FA_STAGE(s, i))], sizeof next[0]);
  for (int l = 0; l < FA_NL; l++)
    if (fire[fa_line_clock[l]] != 0)
      memcpy(T->line[fa_line_place(s, l, fa_line_size[l])], entering[l], sizeof entering[l]);
#endif
  memcpy(T->D, next, sizeof next);
}

static void fa_tangent_record(void *sim, int64_t row) {
  fa_sim *s = sim;
  fa_tangents *T = s->listener;
  double u[FA_SIZE(FA_NI)], j[FA_SIZE(FA_OUTPUTS_NNZ)];
  fa_columns dy[FA_SIZE(FA_NY)];
  fa_inputs(s, s->t, u);
  fa_outputs_values(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, 0, j);
  fa_outputs_tangent(s, j, T->S, T->D, 0, FA_OWN_LANES, dy);
  for (int c = 0; c < FA_DIRS; c++)
    for (int i = 0; i < FA_NY; i++) T->rows[(c * T->height + row) * FA_NY + i] = FA_COLUMN(dy[i], c);
}

/* S0 is (FA_NX, FA_DIRS), D0 (FA_ND, FA_DIRS), rows (FA_DIRS, outputs + 1, FA_NY). */
FA_EXPORT int fa_simulate_tangents(fa_job *job, const double *S0, const double *D0, double *rows, double *least) {
#ifdef FA_BYTECODE
  const fa_job *s = job; /* whose code says the sizes */
#endif
  static _Thread_local fa_tangents T;
  memset(&T, 0, (size_t)((char *)T.line - (char *)&T));
  for (int i = 0; i < FA_NX; i++) memcpy(T.S[i], S0 + i * FA_DIRS, sizeof(double) * FA_DIRS);
  for (int i = 0; i < FA_ND; i++) memcpy(T.D[i], D0 + i * FA_DIRS, sizeof(double) * FA_DIRS);
#ifdef FA_LINES
  for (int i = 0; i < FA_NLR; i++) /* every stage of a line starts alike */
    for (int k = 0; k < fa_line_size[fa_read_line[i]]; k++)
      memcpy(T.line[fa_line_first[fa_read_line[i]] + k], T.D[fa_read_memory[i]], sizeof T.D[0]);
#endif
  T.rows = rows;
  T.height = job->outputs + 1;
  T.least = HUGE_VAL;
  const int status = fa_simulate(job, &T);
  *least = T.least;
  return status;
}
