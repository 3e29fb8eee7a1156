/* The rules announced in tangent.c; included after simulate.c. Jacobians come as nonzeros over the columns
 * [x | t | u | d | q], with their rows and columns in fixed patterns. */

enum { FA_AT_T = FA_NX, FA_AT_U = FA_NX + 1, FA_AT_D = FA_NX + 1 + FA_NI, FA_AT_Q = FA_NX + 1 + FA_NI + FA_ND };

/* Inlined everywhere, so that the number of columns is a constant of each loop over directions. */
#define FA_INLINE static inline __attribute__((always_inline))

/* out += J seeds, for columns 0..cols-1; parameters' own columns only where with_q. */
FA_INLINE void fa_apply(const fa_sim *s, const int *row, const int *col, int n, const double *j, double (*S)[FA_COLS],
                     double (*D)[FA_COLS], const double *dt, int cols, int with_q, double (*out)[FA_COLS]) {
  for (int k = 0; k < n; k++) {
    double *restrict o = out[row[k]];
    const int c = col[k];
    const double v = j[k];
    if (c < FA_AT_T) {
      const double *restrict a = S[c];
      for (int i = 0; i < cols; i++) o[i] += v * a[i];
    } else if (c < FA_AT_D) {
      if (!dt) continue;
      const double rate = c == FA_AT_T ? v : v * s->slope[c - FA_AT_U];
      for (int i = 0; i < cols; i++) o[i] += rate * dt[i];
    } else if (c < FA_AT_Q) {
      const double *restrict a = D[c - FA_AT_D];
      for (int i = 0; i < FA_DIRS; i++) o[i] += v * a[i];
    } else if (with_q) {
      o[c - FA_AT_Q] += v;
    }
  }
}

/* Derivative and its tangent at (t, x). */
FA_INLINE void fa_stage(const fa_sim *s, double t, const double *x, double (*S)[FA_COLS], const double *dt, int cols,
                     double *k, double (*dk)[FA_COLS]) {
  fa_tangents *T = s->listener;
  double u[FA_SIZE(FA_NI)], r[FA_SIZE(FA_NX + FA_DERIVATIVE_NNZ)];
  fa_inputs(s, t, u);
  fa_stage_values(t, x, u, s->d, s->m, s->p, s->cp, s->cm, 0, r);
  memcpy(k, r, sizeof(double) * FA_NX);
  memset(dk, 0, sizeof(double) * FA_SIZE(FA_NX) * FA_COLS);
  fa_apply(s, fa_derivative_row, fa_derivative_col, FA_DERIVATIVE_NNZ, r + FA_NX, S, T->D, dt, cols, 1, dk);
}

/* Tangent of one RK4 step of length h from the present state, into T->S; end receives the state there. dh may be NULL.
 * With with_length, column FA_DIRS of T->S becomes Phi_h: its only seed is a unit change of the length. */
FA_INLINE void fa_tangent_rk4(fa_sim *s, double h, const double *dh, int with_length, double *end) {
  static const double part[4] = {0, 0.5, 0.5, 1};
  fa_tangents *T = s->listener;
  const int cols = with_length ? FA_COLS : FA_DIRS, timed = T->moving || with_length || dh;
  double k[4][FA_SIZE(FA_NX)], x[FA_SIZE(FA_NX)], dt[FA_COLS], length[FA_COLS];
  double dk[4][FA_SIZE(FA_NX)][FA_COLS], y[FA_SIZE(FA_NX)][FA_COLS];
  for (int j = 0; j < FA_DIRS; j++) length[j] = dh ? dh[j] : 0;
  length[FA_DIRS] = with_length;
  T->dt[FA_DIRS] = 0;
  for (int i = 0; i < FA_NX; i++) T->S[i][FA_DIRS] = 0;
  fa_stage(s, s->t, s->x, T->S, timed ? T->dt : 0, cols, k[0], dk[0]);
  for (int a = 1; a < 4; a++) {
    const double c = part[a];
    for (int i = 0; i < FA_NX; i++) {
      x[i] = s->x[i] + c * h * k[a - 1][i];
      for (int j = 0; j < cols; j++) y[i][j] = T->S[i][j] + c * h * dk[a - 1][i][j];
      if (timed) for (int j = 0; j < cols; j++) y[i][j] += c * length[j] * k[a - 1][i];
    }
    if (timed) for (int j = 0; j < cols; j++) dt[j] = T->dt[j] + c * length[j];
    fa_stage(s, s->t + c * h, x, y, timed ? dt : 0, cols, k[a], dk[a]);
  }
  for (int i = 0; i < FA_NX; i++) {
    const double mean = (k[0][i] + 2 * (k[1][i] + k[2][i]) + k[3][i]) / 6;
    end[i] = s->x[i] + h * mean;
    for (int j = 0; j < cols; j++)
      T->S[i][j] += h / 6 * (dk[0][i][j] + 2 * (dk[1][i][j] + dk[2][i][j]) + dk[3][i][j]);
    if (timed) for (int j = 0; j < cols; j++) T->S[i][j] += length[j] * mean;
  }
}

static int fa_any_nonzero(const double *a) {
  for (int j = 0; j < FA_DIRS; j++) if (a[j] != 0) return 1;
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
          T->goal[fa_following_col[k] - FA_AT_Q] += r[k];
    }
    T->moving = fa_any_nonzero(T->begin) || fa_any_nonzero(T->goal);
  }
  const double share = (double)i / (double)n;
  for (int j = 0; j < FA_DIRS; j++) T->aim[j] = i == n ? T->goal[j] : T->begin[j] + (T->goal[j] - T->begin[j]) * share;
}

static void fa_tangent_step(void *sim, double h, int guard) {
  fa_sim *s = sim;
  fa_tangents *T = s->listener;
  double end[FA_SIZE(FA_NX)], dh[FA_COLS];
  if (guard < 0) {
    for (int j = 0; j < FA_DIRS; j++) dh[j] = T->aim[j] - T->dt[j];
    fa_tangent_rk4(s, h, T->moving ? dh : 0, 0, end);
    memcpy(T->dt, T->aim, sizeof T->dt);
    return;
  }
  double u[FA_SIZE(FA_NI)], j[FA_SIZE(FA_GUARDS_NNZ)], dg[FA_SIZE(FA_NG)][FA_COLS], size = 1e-300;
  fa_tangent_rk4(s, h, 0, 1, end);
  fa_inputs(s, s->t + h, u);
  fa_guards_values(s->t + h, end, u, s->d, s->m, s->p, s->cp, s->cm, 0, j);
  memset(dg, 0, sizeof dg);
  T->dt[FA_DIRS] = 1;
  fa_apply(s, fa_guards_row, fa_guards_col, FA_GUARDS_NNZ, j, T->S, T->D, T->dt, FA_COLS, 1, dg);
  T->dt[FA_DIRS] = 0;
  for (int k = 0; k < FA_GUARDS_NNZ; k++)
    if (fa_guards_row[k] == guard && fa_guards_col[k] < FA_AT_T) size += fabs(j[k] * T->S[fa_guards_col[k]][FA_DIRS]);
  const double rate = dg[guard][FA_DIRS];
  if (fabs(rate) / size < T->least) T->least = fabs(rate) / size;
  if (rate == 0) return;
  for (int c = 0; c < FA_DIRS; c++) {
    const double later = -dg[guard][c] / rate;
    for (int i = 0; i < FA_NX; i++) T->S[i][c] += T->S[i][FA_DIRS] * later;
    T->dt[c] += later;
  }
  T->moving = 1;
}

static void fa_tangent_tick(void *sim, const double *fire) {
  fa_sim *s = sim;
  fa_tangents *T = s->listener;
  double u[FA_SIZE(FA_NI)], j[FA_SIZE(FA_UPDATE_NNZ)], next[FA_SIZE(FA_ND)][FA_COLS];
  fa_inputs(s, s->t, u);
  fa_update_values(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, fire, j);
  memset(next, 0, sizeof next);
  fa_apply(s, fa_update_row, fa_update_col, FA_UPDATE_NNZ, j, T->S, T->D, 0, FA_DIRS, 1, next);
#if FA_NL
  double v[FA_SIZE(FA_ENTERING_NNZ)], entering[FA_NL][FA_COLS];
  fa_entering_values(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, fire, v);
  memset(entering, 0, sizeof entering);
  fa_apply(s, fa_entering_row, fa_entering_col, FA_ENTERING_NNZ, v, T->S, T->D, 0, FA_DIRS, 1, entering);
  for (int i = 0; i < FA_NLR; i++)
    if (fire[fa_line_clock[fa_read_line[i]]] != 0)
      memcpy(next[fa_read_memory[i]], T->line[fa_line_place(s, fa_read_line[i], fa_read_stage[i])], sizeof next[0]);
  for (int l = 0; l < FA_NL; l++)
    if (fire[fa_line_clock[l]] != 0)
      memcpy(T->line[fa_line_place(s, l, fa_line_size[l])], entering[l], sizeof entering[l]);
#endif
  memcpy(T->D, next, sizeof next);
}

static void fa_tangent_record(void *sim, int64_t row) {
  fa_sim *s = sim;
  fa_tangents *T = s->listener;
  double u[FA_SIZE(FA_NI)], j[FA_SIZE(FA_OUTPUTS_NNZ)], dy[FA_SIZE(FA_NY)][FA_COLS];
  fa_inputs(s, s->t, u);
  fa_outputs_values(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, 0, j);
  memset(dy, 0, sizeof dy);
  fa_apply(s, fa_outputs_row, fa_outputs_col, FA_OUTPUTS_NNZ, j, T->S, T->D, 0, FA_DIRS, 1, dy);
  for (int i = 0; i < FA_NY; i++)
    memcpy(T->rows + (row * FA_NY + i) * FA_DIRS, dy[i], sizeof(double) * FA_DIRS);
}

/* S0 is (FA_NX, FA_DIRS), D0 (FA_ND, FA_DIRS), rows (outputs + 1, FA_NY, FA_DIRS). */
FA_EXPORT int fa_simulate_tangents(fa_job *job, const double *S0, const double *D0, double *rows, double *least) {
  static _Thread_local fa_tangents T;
  memset(&T, 0, sizeof T);
  for (int i = 0; i < FA_NX; i++) memcpy(T.S[i], S0 + i * FA_DIRS, sizeof(double) * FA_DIRS);
  for (int i = 0; i < FA_ND; i++) memcpy(T.D[i], D0 + i * FA_DIRS, sizeof(double) * FA_DIRS);
#if FA_NL
  for (int i = 0; i < FA_NLR; i++) /* every stage of a line starts alike */
    for (int k = 0; k < fa_line_size[fa_read_line[i]]; k++)
      memcpy(T.line[fa_line_first[fa_read_line[i]] + k], T.D[fa_read_memory[i]], sizeof(double) * FA_DIRS);
#endif
  T.rows = rows;
  T.least = HUGE_VAL;
  const int status = fa_simulate(job, &T);
  *least = T.least;
  return status;
}
