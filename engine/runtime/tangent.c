/* Tangents of a run: the discrete algorithm differentiated, through located events.
 *
 * S = dx/dq, one column per direction q: first FA_NTH parameters, then starting values. A step of length h from (t, x) is
 * x1 = Phi(x, t, h); its tangent carries the seeds dx, dt, dh. A step that ends on a guard g has the length tau with
 * g(Phi(x, t, tau), t + tau) = 0, so
 *
 *     dtau = -(g_x (Phi_x dx + Phi_t dt + Phi_q) + g_t dt + g_q) / (g_x Phi_h + g_t)
 *
 * and what remains of the step is shorter by as much. Column FA_DIRS carries Phi_h. The columns lie in lanes of a
 * processor's vectors; those beyond FA_DIRS stay zero. Included before core.c. */

#ifndef FA_BYTECODE
#define FA_MOST_DIRS FA_DIRS
#endif
#define FA_WIDTH 4
#define FA_LANES (FA_MOST_DIRS / FA_WIDTH + 1)
typedef double fa_lane __attribute__((vector_size(FA_WIDTH * sizeof(double)), may_alias));
typedef fa_lane fa_columns[FA_LANES];
#define FA_OWN_LANES ((FA_MOST_DIRS + FA_WIDTH - 1) / FA_WIDTH) /* without column FA_DIRS, which is for events */
#define FA_EACH(l) for (int l = 0; l < FA_LANES; l++)
#define FA_EACH_OF(lanes, l) for (int l = 0; l < (lanes); l++)
#define FA_COLUMN(v, c) (v)[(c) / FA_WIDTH][(c) % FA_WIDTH]

static void fa_tangent_target(void *sim, int event, int64_t i, int64_t n);
static void fa_tangent_step(void *sim, const void *trial, int guard);
static void fa_tangent_stop(void *sim, int coordinate);
static void fa_tangent_tick(void *sim, const double *fire);
static void fa_tangent_record(void *sim, int64_t row);

#define FA_HOOKS
#define FA_ON_TARGET(s, event, i, n) fa_tangent_target(s, (event), (i), (n))
#define FA_ON_STEP(s, trial, guard) fa_tangent_step(s, (trial), (guard))
#define FA_ON_STOP(s, coordinate) fa_tangent_stop(s, (coordinate))
#define FA_ON_TICK(s, fire) fa_tangent_tick(s, (fire))
#define FA_ON_RECORD(s, row) fa_tangent_record(s, (row))
