/* What generated code writes out for each Jacobian, by its pattern; sums are taken in the same order. */

#define FA_DERIVATIVE_NNZ FA_CODE->program[FA_DERIVATIVE_VALUES].count
#define FA_GUARDS_NNZ FA_CODE->program[FA_GUARDS_VALUES].count
#define FA_UPDATE_NNZ FA_CODE->program[FA_UPDATE_VALUES].count
#define FA_OUTPUTS_NNZ FA_CODE->program[FA_OUTPUTS_VALUES].count
#define FA_SHARED (FA_CODE->derivative.rows - FA_NX)
#define FA_FOLLOWING_NNZ FA_CODE->program[FA_FOLLOWING_VALUES].count
#define FA_ENTERING_NNZ FA_CODE->program[FA_ENTERING_VALUES].count
#define fa_guards_row FA_CODE->guards_row
#define fa_guards_col FA_CODE->guards_col
#define fa_following_row FA_CODE->following_row
#define fa_following_col FA_CODE->following_col

/* Columns of a Jacobian: [x | t | u | d | q]. */
#define FA_AT_T FA_NX
#define FA_AT_Q (FA_NX + 1 + FA_NI + FA_ND)
#define FA_INLINE static inline __attribute__((always_inline))

enum { FA_OF_STATE, FA_OF_MEMORY, FA_OF_SHARED, FA_OF_TIME, FA_OF_INPUT, FA_OF_PARAMETER };

/* The values of the derivative's Jacobian at the four stages of a step, which are lanes. */
static void fa_stages(const fa_sim *s, fa_lane t, const fa_lane *x, const fa_lane *u, fa_lane *r) {
  const fa_code *code = FA_CODE;
  const fa_program *program = &code->program[FA_DERIVATIVE_VALUES];
  if (program->lanes) {
    fa_lane wide[code->registers]; /* what is not worked out here is read where it lies */
    wide[0] = t;
    for (int i = 0; i < FA_NX; i++) wide[FA_X + i] = x[i];
    for (int i = 0; i < FA_NI; i++) wide[FA_U + i] = u[i];
    program->lanes(wide, s->file, s->d, r, fa_bits);
    return;
  }
  double state[FA_SIZE(FA_NX)], input[FA_SIZE(FA_NI)], found[FA_SIZE(FA_DERIVATIVE_NNZ)];
  for (int a = 0; a < FA_WIDTH; a++) {
    for (int i = 0; i < FA_NX; i++) state[i] = x[i][a];
    for (int i = 0; i < FA_NI; i++) input[i] = u[i][a];
    fa_evaluate_program(code, s->file, FA_DERIVATIVE_VALUES, t[a], state, input, s->d, 0, found);
    for (int k = 0; k < FA_DERIVATIVE_NNZ; k++) r[k][a] = found[k];
  }
}
#define fa_derivative_values_lanes(t, x, u, d, m, p, cp, cm, fire, r) fa_stages(s, t, x, u, r)

FA_INLINE void fa_apply(const fa_sim *s, const fa_pattern *p, const double *j, const fa_columns *S, const fa_columns *D,
                        const fa_lane *dt, int lanes, fa_columns *out) {
  for (int64_t i = 0; i < p->rows; i++) {
    int64_t k = p->first[i];
    const int64_t last = p->first[i + 1];
    fa_columns sum;
    FA_EACH_OF(lanes, l) sum[l] = (fa_lane){0};
    const fa_columns *const of[] = {S, D, out}; /* by kind */
    for (int started = 0; k < last && p->kind[k] <= FA_OF_SHARED; k++, started = 1) {
      const fa_lane *from = of[p->kind[k]][p->at[k]];
      if (started) FA_EACH_OF(lanes, l) sum[l] += j[p->value[k]] * from[l];
      else FA_EACH_OF(lanes, l) sum[l] = j[p->value[k]] * from[l];
    }
    if (k < last && p->kind[k] <= FA_OF_INPUT) {
      double rate = 0;
      for (int first = 1; k < last && p->kind[k] <= FA_OF_INPUT; k++, first = 0) {
        const double part = p->kind[k] == FA_OF_TIME ? j[p->value[k]] : j[p->value[k]] * s->slope[p->at[k]];
        rate = first ? part : rate + part;
      }
      if (dt) FA_EACH_OF(lanes, l) sum[l] += rate * dt[l];
    }
    FA_EACH_OF(lanes, l) out[p->row[i]][l] = sum[l];
    for (; k < last; k++) FA_COLUMN(out[p->row[i]], p->at[k]) += j[p->value[k]];
  }
}

#define FA_TANGENT(name)                                                                                        \
  static void fa_##name##_tangent(const fa_sim *s, const double *j, const fa_columns *S, const fa_columns *D, \
                                  const fa_lane *dt, int lanes, fa_columns *out) {                            \
    if (FA_CODE->name.machine && !dt && lanes == FA_OWN_LANES) FA_CODE->name.machine(j, S, D, out);            \
    else fa_apply(s, &FA_CODE->name, j, S, D, dt, lanes, out);                                                 \
  }
FA_TANGENT(derivative)
FA_TANGENT(guards)
FA_TANGENT(update)
FA_TANGENT(outputs)
FA_TANGENT(entering)
