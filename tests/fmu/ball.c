/* A bouncing ball of another maker, FMI 2 Co-Simulation: h'' = thrust - gravity above the ground, and at the ground the
 * speed v becomes -restitution v. Thrust is held over a step, so each flight is a parabola, followed exactly. */
#include <math.h>
#include <stddef.h>
#include <string.h>

#define API __attribute__((visibility("default")))
enum { THRUST, HEIGHT, SPEED, BOUNCES, GRAVITY, RESTITUTION, DROP, COUNT };
static double value[COUNT];
#define SLOWEST 1e-6                                          /* a ball that leaves the ground slower stays there */

API const char *fmi2GetTypesPlatform(void) { return "default"; }
API const char *fmi2GetVersion(void) { return "2.0"; }
API void *fmi2Instantiate(const char *n, int k, const char *g, const char *r, const void *c, int v, int l) {
  memset(value, 0, sizeof value);
  value[GRAVITY] = 9.81;
  value[RESTITUTION] = 0.7;
  value[DROP] = 1;
  return value;
}
API void fmi2FreeInstance(void *c) {}
API int fmi2SetDebugLogging(void *c, int on, size_t n, const char *const *names) { return 0; }
API int fmi2SetupExperiment(void *c, int d, double t, double s, int e, double x) { return 0; }
API int fmi2EnterInitializationMode(void *c) { return 0; }
API int fmi2ExitInitializationMode(void *c) {
  value[HEIGHT] = value[DROP];
  return 0;
}
API int fmi2Terminate(void *c) { return 0; }
API int fmi2Reset(void *c) { return 0; }
API int fmi2GetReal(void *c, const unsigned *r, size_t n, double *v) {
  for (size_t i = 0; i < n; i++) v[i] = value[r[i]];
  return 0;
}
API int fmi2SetReal(void *c, const unsigned *r, size_t n, const double *v) {
  for (size_t i = 0; i < n; i++) value[r[i]] = v[i];
  return 0;
}

/* When a ball at height h with speed v and acceleration a next comes down to the ground. */
static double landing(double h, double v, double a) {
  const double root = v * v - 2 * a * h;
  if (root < 0) return HUGE_VAL;
  if (a == 0) return v < 0 ? -h / v : HUGE_VAL;
  if (a < 0) return (-v - sqrt(root)) / a;                    /* of the two roots the later one */
  return v < 0 ? 2 * h / (-v + sqrt(root)) : HUGE_VAL;        /* of the two roots the earlier one, while it falls */
}

API int fmi2DoStep(void *c, double t, double step, int no) {
  const double a = value[THRUST] - value[GRAVITY];
  for (double left = step; left > 0;) {
    const int rests = value[HEIGHT] == 0 && value[SPEED] == 0 && a <= 0;
    const double at = rests ? HUGE_VAL : landing(value[HEIGHT], value[SPEED], a), go = fmin(at, left);
    if (!rests) {
      value[HEIGHT] += go * (value[SPEED] + a * go / 2);
      value[SPEED] += a * go;
    }
    left -= go;
    if (at > go) continue;
    value[HEIGHT] = 0;
    value[SPEED] *= -value[RESTITUTION];
    value[BOUNCES]++;
    if (fabs(value[SPEED]) < SLOWEST) value[SPEED] = 0;
  }
  return 0;
}
#include "foreign_unused.h"
