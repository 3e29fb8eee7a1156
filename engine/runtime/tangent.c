/* Tangents of a run: the discrete algorithm differentiated, through located events.
 *
 * S = dx/dq, one column per direction q: first FA_NTH parameters, then starting values. A step of length h from (t, x) is
 * x1 = Phi(x, t, h); its tangent carries the seeds dx, dt, dh. A step that ends on a guard g has the length tau with
 * g(Phi(x, t, tau), t + tau) = 0, so
 *
 *     dtau = -(g_x (Phi_x dx + Phi_t dt + Phi_q) + g_t dt + g_q) / (g_x Phi_h + g_t)
 *
 * and what remains of the step is shorter by as much. Column FA_DIRS carries Phi_h. Included before core.c. */

#define FA_COLS (FA_DIRS + 1)
typedef struct {
  double S[FA_NX > 0 ? FA_NX : 1][FA_COLS];      /* states */
  double D[FA_ND > 0 ? FA_ND : 1][FA_COLS];      /* memories */
  double line[FA_NLS > 0 ? FA_NLS : 1][FA_COLS]; /* values in the delay lines */
  double dt[FA_COLS], aim[FA_COLS];              /* of the present time, of the step's end */
  double begin[FA_COLS], goal[FA_COLS];          /* of the segment's start and end, which several steps may divide */
  int moving;                                    /* whether any of these is not zero */
  double *rows;                                  /* output tangents, (row, output, direction) */
  double least;                                  /* smallest |g_x Phi_h + g_t| met, relative; small means grazing */
} fa_tangents;

static void fa_tangent_target(void *sim, int event, int64_t i, int64_t n);
static void fa_tangent_step(void *sim, double h, int guard);
static void fa_tangent_tick(void *sim, const double *fire);
static void fa_tangent_record(void *sim, int64_t row);

#define FA_HOOKS
#define FA_ON_TARGET(s, event, i, n) fa_tangent_target(s, (event), (i), (n))
#define FA_ON_STEP(s, h, guard) fa_tangent_step(s, (h), (guard))
#define FA_ON_STOP(s, c) memset(((fa_tangents *)(s)->listener)->S[FA_NQ + (c)], 0, sizeof(double) * FA_COLS)
#define FA_ON_TICK(s, fire) fa_tangent_tick(s, (fire))
#define FA_ON_RECORD(s, row) fa_tangent_record(s, (row))
