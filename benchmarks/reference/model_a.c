/* Reference model A, written by hand: a DC motor without inductance turns, through a gear, a flexible link of four
 * clamped-free modes with the terms in w^2. With theta the angle of the hub, w its speed, a_i the modes, b_i their speeds:
 *
 *   (J + m sum a_i^2) w' + sum c_i b_i' = gear torque - B w - 2 m w sum a_i b_i
 *   c_i w' + m b_i' = -K_i a_i - D_i b_i + m a_i w^2
 *
 *   gear torque = eta_g n eta_m kt (V - km n w) / R,    J = eta_g n^2 Jm + Jg + Jh + m L^2 / 3,    c_i = 2 m L / beta_i^2
 *   K_i = EI beta_i^4 / L^3,    D_i = 2 xi sqrt(K_i m)
 *
 * The second row gives b_i' = f_i - r_i w' with r_i = c_i / m; put into the first, one division is left. */

#include <math.h>
#include <stdint.h>

#define N 10 /* theta, a[4], w, b[4] */

static const double beta[4] = {1.8751040687119611, 4.694091132974174, 7.854757438237613, 10.995540734875467};

typedef struct { double R, drive, brake, J, m, n, k[4], d[4], r[4], c[4], tip[4]; } constants;

static constants prepare(void) {
  const double R = 2.6, kt = 7.68e-3, km = 7.68e-3, motor = 0.69, Jm = 4.606e-7, n = 70, gear = 0.9, Jg = 4.8754e-5;
  const double B = 0.004, L = 0.419, m = 65e-3, EI = 0.137422, Jh = 3e-4, xi = 0.01;
  constants c = {.R = R, .m = m, .n = n};
  c.drive = gear * n * motor * kt / R;
  c.brake = c.drive * km * n + B;
  c.J = gear * n * n * Jm + Jg + Jh + m * L * L / 3;
  for (int i = 0; i < 4; i++) {
    const double K = EI / (L * L * L) * beta[i] * beta[i] * beta[i] * beta[i];
    c.k[i] = K / m;
    c.d[i] = 2 * xi * sqrt(K * m) / m;
    c.c[i] = 2 * m * L / (beta[i] * beta[i]);
    c.r[i] = c.c[i] / m;
    c.J -= c.c[i] * c.r[i];
    c.tip[i] = i % 2 ? -2 : 2;
  }
  return c;
}

/* Steps that have come at the k-th millisecond, and whether the sweep is on: the instants are whole milliseconds. */
static void phases(int64_t k, double *level, int *sweep) {
  *level = (k >= 200 && k < 1200 ? 2 : 0) + (k >= 1700 && k < 2900 ? -1.5 : 0) + (k >= 3300 && k < 3800 ? 0.75 : 0);
  *sweep = k >= 4000 && k < 10000;
}

static double voltage(double t, double level, int sweep) {
  if (!sweep) return level;
  const double x = (t - 4) / 6;
  return level + sin(2 * 3.14159265358979323846 * 6 * x * (0.5 + (12 - 0.5) * x / 2));
}

static inline void derivative(const constants *c, const double *restrict x, double V, double *restrict r) {
  const double w = x[5], w2 = w * w;
  double torque = c->drive * V - c->brake * w, squares = 0, powers = 0;
  for (int i = 0; i < 4; i++) {
    const double a = x[1 + i], b = x[6 + i], f = a * w2 - c->k[i] * a - c->d[i] * b;
    r[6 + i] = f;
    r[1 + i] = b;
    torque -= c->c[i] * f;
    squares += a * a;
    powers += a * b;
  }
  const double turning = (torque - 2 * c->m * w * powers) / (c->J + c->m * squares);
  r[0] = w;
  r[5] = turning;
  for (int i = 0; i < 4; i++) r[6 + i] -= c->r[i] * turning;
}

static void record(const constants *c, const double *x, double V, double *y) {
  double deflection = 0;
  for (int i = 0; i < 4; i++) deflection += c->tip[i] * x[1 + i];
  y[0] = V;
  y[1] = c->n * x[5];
  y[2] = x[0];
  y[3] = x[5];
  y[4] = deflection;
}

/* rows outputs 1 ms apart after the first, parts steps of RK4 between two; y: voltage, motor speed, angle, speed, tip. */
__attribute__((visibility("default"))) int reference(int64_t rows, int64_t parts, double *y) {
  const constants c = prepare();
  double x[N] = {0}, k1[N], k2[N], k3[N], k4[N], z[N], level;
  int sweep;
  const double h = 1e-3 / (double)parts;
  phases(0, &level, &sweep);
  record(&c, x, voltage(0, level, sweep), y);
  for (int64_t k = 0; k < rows; k++) {
    for (int64_t part = 0; part < parts; part++) {
      const double t = (double)k * 1e-3 + (double)part * h;
      const double middle = voltage(t + h / 2, level, sweep);
      derivative(&c, x, voltage(t, level, sweep), k1);
      for (int i = 0; i < N; i++) z[i] = x[i] + h / 2 * k1[i];
      derivative(&c, z, middle, k2);
      for (int i = 0; i < N; i++) z[i] = x[i] + h / 2 * k2[i];
      derivative(&c, z, middle, k3);
      for (int i = 0; i < N; i++) z[i] = x[i] + h * k3[i];
      derivative(&c, z, voltage(t + h, level, sweep), k4);
      for (int i = 0; i < N; i++) x[i] += h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
    }
    phases(k + 1, &level, &sweep);
    record(&c, x, voltage((double)(k + 1) * 1e-3, level, sweep), y + 5 * (k + 1));
  }
  return 0;
}
