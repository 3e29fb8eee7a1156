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

FA_INLINE void fa_apply(const fa_sim *s, const fa_pattern *p, const double *j, const fa_columns *S, const fa_columns *D,
                        const fa_lane *dt, fa_columns *out) {
  for (int64_t i = 0; i < p->rows; i++) {
    int64_t k = p->first[i];
    const int64_t last = p->first[i + 1];
    fa_columns sum;
    FA_EACH(l) sum[l] = (fa_lane){0};
    const fa_columns *const of[] = {S, D, out}; /* by kind */
    for (int started = 0; k < last && p->kind[k] <= FA_OF_SHARED; k++, started = 1) {
      const fa_lane *from = of[p->kind[k]][p->at[k]];
      if (started) FA_EACH(l) sum[l] += j[p->value[k]] * from[l];
      else FA_EACH(l) sum[l] = j[p->value[k]] * from[l];
    }
    if (k < last && p->kind[k] <= FA_OF_INPUT) {
      double rate = 0;
      for (int first = 1; k < last && p->kind[k] <= FA_OF_INPUT; k++, first = 0) {
        const double part = p->kind[k] == FA_OF_TIME ? j[p->value[k]] : j[p->value[k]] * s->slope[p->at[k]];
        rate = first ? part : rate + part;
      }
      if (dt) FA_EACH(l) sum[l] += rate * dt[l];
    }
    FA_EACH(l) out[p->row[i]][l] = sum[l];
    for (; k < last; k++) FA_COLUMN(out[p->row[i]], p->at[k]) += j[p->value[k]];
  }
}

#define FA_TANGENT(name)                                                                                        \
  static void fa_##name##_tangent(const fa_sim *s, const double *j, const fa_columns *S, const fa_columns *D, \
                                  const fa_lane *dt, int lanes, fa_columns *out) {                            \
    (void)lanes;                                                                                               \
    if (FA_CODE->name.machine && !dt) FA_CODE->name.machine(j, S, D, out);                                     \
    else fa_apply(s, &FA_CODE->name, j, S, D, dt, out);                                                        \
  }
FA_TANGENT(derivative)
FA_TANGENT(guards)
FA_TANGENT(update)
FA_TANGENT(outputs)
FA_TANGENT(entering)
