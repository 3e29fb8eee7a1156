/* The rules announced in tangent.c; included after simulate.c and the generated fa_NAME_tangent, which carry seeds
 * through the Jacobian of a function of the model: out = J [S | dt | slope dt | D] + the parameters' own columns. */

typedef struct {
  fa_columns S[FA_ROOM(FA_NX)];             /* states */
  fa_columns D[FA_ROOM(FA_ND)];             /* memories */
  fa_columns line[FA_ROOM_LINE];            /* values in the delay lines */
  fa_columns dt, aim;                       /* of the present time, of the step's end */
  fa_columns begin, goal;                   /* of the segment's start and end, which several steps may divide */
  int moving;                               /* whether any of these is not zero */
  double *rows;                             /* output tangents, (direction, row, output) */
  int64_t height;                           /* how many rows */
  double least;                             /* smallest |g_x Phi_h + g_t| met, relative; small means grazing */
} fa_tangents;

/* Derivative and its tangent at (t, x). */
FA_INLINE void fa_stage(const fa_sim *s, double t, const double *x, const fa_columns *S, const fa_lane *dt, double *k,
                        fa_columns *dk) {
  const fa_tangents *T = s->listener;
  double u[FA_SIZE(FA_NI)], r[FA_SIZE(FA_NX + FA_DERIVATIVE_NNZ)];
  fa_inputs(s, t, u);
  fa_stage_values(t, x, u, s->d, s->m, s->p, s->cp, s->cm, 0, r);
  memcpy(k, r, sizeof(double) * FA_NX);
  fa_derivative_tangent(s, r + FA_NX, S, T->D, dt, dk);
}

/* Tangent of one RK4 step of length h from the present state, into T->S; end receives the state there. dh may be NULL.
 * With with_length, column FA_DIRS of T->S becomes Phi_h: its only seed is a unit change of the length. */
FA_INLINE void fa_tangent_rk4(fa_sim *s, double h, const fa_lane *dh, int with_length, double *end) {
  static const double part[4] = {0, 0.5, 0.5, 1};
  fa_tangents *T = s->listener;
  const int timed = T->moving || with_length || dh;
  double k[4][FA_SIZE(FA_NX)], x[FA_SIZE(FA_NX)];
  fa_columns dk[4][FA_SIZE(FA_NX)], y[FA_SIZE(FA_NX)], dt, length;
  FA_EACH(l) length[l] = dh ? dh[l] : (fa_lane){0};
  FA_COLUMN(length, FA_DIRS) = with_length;
  fa_stage(s, s->t, s->x, T->S, timed ? T->dt : 0, k[0], dk[0]);
  for (int a = 1; a < 4; a++) {
    const double c = part[a];
    for (int i = 0; i < FA_NX; i++) {
      x[i] = s->x[i] + c * h * k[a - 1][i];
      FA_EACH(l) y[i][l] = T->S[i][l] + c * h * dk[a - 1][i][l];
      if (timed) FA_EACH(l) y[i][l] += c * length[l] * k[a - 1][i];
    }
    if (timed) FA_EACH(l) dt[l] = T->dt[l] + c * length[l];
    fa_stage(s, s->t + c * h, x, y, timed ? dt : 0, k[a], dk[a]);
  }
  for (int i = 0; i < FA_NX; i++) {
    const double mean = (k[0][i] + 2 * (k[1][i] + k[2][i]) + k[3][i]) / 6;
    end[i] = s->x[i] + h * mean;
    FA_EACH(l) T->S[i][l] += h / 6 * (dk[0][i][l] + 2 * (dk[1][i][l] + dk[2][i][l]) + dk[3][i][l]);
    if (timed) FA_EACH(l) T->S[i][l] += length[l] * mean;
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

static void fa_tangent_step(void *sim, double h, int guard) {
  fa_sim *s = sim;
  fa_tangents *T = s->listener;
  double end[FA_SIZE(FA_NX)];
  if (guard < 0) {
    fa_columns dh;
    FA_EACH(l) dh[l] = T->aim[l] - T->dt[l];
    fa_tangent_rk4(s, h, T->moving ? dh : 0, 0, end);
    memcpy(T->dt, T->aim, sizeof T->dt);
    return;
  }
  double u[FA_SIZE(FA_NI)], j[FA_SIZE(FA_GUARDS_NNZ)], size = 1e-300;
  fa_columns dg[FA_SIZE(FA_NG)], unit;
  fa_tangent_rk4(s, h, 0, 1, end);
  fa_inputs(s, s->t + h, u);
  fa_guards_values(s->t + h, end, u, s->d, s->m, s->p, s->cp, s->cm, 0, j);
  memcpy(unit, T->dt, sizeof unit);
  FA_COLUMN(unit, FA_DIRS) = 1;
  fa_guards_tangent(s, j, T->S, T->D, unit, dg);
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
  fa_update_tangent(s, j, T->S, T->D, 0, next);
#ifdef FA_LINES
  double v[FA_SIZE(FA_ENTERING_NNZ)];
  fa_columns entering[FA_SIZE(FA_NL)];
  fa_entering_values(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, fire, v);
  fa_entering_tangent(s, v, T->S, T->D, 0, entering);
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
  fa_outputs_tangent(s, j, T->S, T->D, 0, dy);
  for (int c = 0; c < FA_DIRS; c++)
    for (int i = 0; i < FA_NY; i++) T->rows[(c * T->height + row) * FA_NY + i] = FA_COLUMN(dy[i], c);
}

/* S0 is (FA_NX, FA_DIRS), D0 (FA_ND, FA_DIRS), rows (FA_DIRS, outputs + 1, FA_NY). */
FA_EXPORT int fa_simulate_tangents(fa_job *job, const double *S0, const double *D0, double *rows, double *least) {
#ifdef FA_BYTECODE
  const fa_job *s = job; /* whose code says the sizes */
#endif
  static _Thread_local fa_tangents T;
  memset(&T, 0, sizeof T);
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
