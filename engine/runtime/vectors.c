/* Vectors that hold one double of each of FA_WIDTH runs, for generated functions; see lanes.c. Included before them.
 * Without vectors of at least four doubles, runs are carried out one after another. */

#ifndef FA_WIDTH
#if defined(__AVX512F__) && !defined(FA_BYTECODE) /* byte code is translated for four */
#define FA_WIDTH 8
#elif defined(__AVX2__)
#define FA_WIDTH 4
#else
#define FA_WIDTH 1
#endif
#endif

#define FA_EACH_LANE(l) for (int l = 0; l < FA_WIDTH; l++)
typedef double fa_lane __attribute__((vector_size(FA_WIDTH * sizeof(double)), may_alias));
typedef int64_t fa_mask __attribute__((vector_size(FA_WIDTH * sizeof(int64_t)), may_alias)); /* a lane is -1 or 0 */

#if FA_WIDTH == 8
#define FA_ALL(c) ((fa_lane){c, c, c, c, c, c, c, c})
#elif FA_WIDTH == 4
#define FA_ALL(c) ((fa_lane){c, c, c, c})
#else
#define FA_ALL(c) ((fa_lane){c})
#endif
static inline fa_mask fa_true(fa_lane a) { return a != 0; }
static inline fa_mask fa_sign_bits(fa_lane a) { return (fa_mask)a >> 63; }
static inline fa_lane fa_where(fa_mask yes, fa_lane a) { return (fa_lane)(yes & (fa_mask)a); }
static inline fa_lane fa_flag(fa_mask yes) { return fa_where(yes, FA_ALL(1.0)); }
static inline fa_lane fa_chosen(fa_mask yes, fa_lane a, fa_lane b) {
  return (fa_lane)((yes & (fa_mask)a) | (~yes & (fa_mask)b));
}
static inline int fa_any(fa_mask yes) {
  int64_t found = 0;
  FA_EACH_LANE(l) found |= yes[l];
  return found != 0;
}

/* fa_exp in every lane. */
static inline fa_lane fa_exp_lanes(fa_lane x) {
  fa_lane rest, power;
  if (fa_any(~((x > -650) & (x < 709)))) {
    FA_EACH_LANE(l) power[l] = fa_exp(x[l]);
    return power;
  }
  const fa_lane shifted = x * FA_PER_LN2 + FA_WHOLE, n = shifted - FA_WHOLE;
  const fa_lane r = x - n * FA_LN2_HIGH - n * FA_LN2_LOW, rr = r * r;
  const fa_mask whole = (fa_mask)shifted;
  fa_mask bits;
  FA_EACH_LANE(l) {
    rest[l] = fa_powers[whole[l] & 127].rest;
    bits[l] = fa_powers[whole[l] & 127].bits;
  }
  power = (fa_lane)(bits + (whole << 45));
  return power + power * (rest + r + rr * (1.0 / 2 + r * (1.0 / 6)) + rr * rr * (1.0 / 24 + r * (1.0 / 120)));
}

/* Whether all lanes have the same bits, as what depends on time alone. */
static inline int fa_same(fa_lane a) { return !fa_any((fa_mask)a ^ (fa_mask)FA_ALL(a[0])); }

/* A value of lane l in every lane, worked out once if that is known to be the same in all. */
#define FA_LANE_BY_LANE(same, value)                                                                        \
  ({                                                                                                        \
    fa_lane r_;                                                                                             \
    if (same) {                                                                                             \
      const int l = 0;                                                                                      \
      const double one_ = (value);                                                                          \
      r_ = FA_ALL(one_);                                                                                    \
    } else FA_EACH_LANE(l) r_[l] = (value);                                                                 \
    r_;                                                                                                     \
  })
