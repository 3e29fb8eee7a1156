/* The problems of benchmarks/peers, written by hand: RK4 with four stages a step, doubles, no library.
 *
 * linear: x' = A x + b u(t), y = c x, u = 1 from rows `on` to `off`; A of order n <= 16, by rows.
 * sliding: J w' = T sin(2 pi f t) - k q - d w - F, dry friction of level F that sticks, its switches located to 1e-13.
 * two_links: two uniform rods hinged in a vertical plane, with a spring between them. */

#include <math.h>
#include <stdint.h>

#define MOST 16

static void rate(int n, const double *A, const double *b, double u, const double *x, double *r) {
  for (int i = 0; i < n; i++) {
    double sum = b[i] * u;
    for (int j = 0; j < n; j++) sum += A[i * n + j] * x[j];
    r[i] = sum;
  }
}

__attribute__((visibility("default"))) void linear(int64_t n, const double *A, const double *b, const double *c,
                                                   int64_t rows, int64_t on, int64_t off, double h, double *y) {
  double x[MOST] = {0}, z[MOST], k1[MOST], k2[MOST], k3[MOST], k4[MOST];
  for (int64_t row = 0; row <= rows; row++) {
    y[row] = 0;
    for (int i = 0; i < n; i++) y[row] += c[i] * x[i];
    const double u = row >= on && row < off;
    rate((int)n, A, b, u, x, k1);
    for (int i = 0; i < n; i++) z[i] = x[i] + h / 2 * k1[i];
    rate((int)n, A, b, u, z, k2);
    for (int i = 0; i < n; i++) z[i] = x[i] + h / 2 * k2[i];
    rate((int)n, A, b, u, z, k3);
    for (int i = 0; i < n; i++) z[i] = x[i] + h * k3[i];
    rate((int)n, A, b, u, z, k4);
    for (int i = 0; i < n; i++) x[i] += h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
  }
}

typedef struct { double J, k, d, T, w, F; } law;

static double push(const law *p, double t, double q, double v) { return p->T * sin(p->w * t) - p->k * q - p->d * v; }

static void step(const law *p, double t, double h, int slip, const double *x, double *out) {
  const double a1 = (push(p, t, x[0], x[1]) - slip * p->F) / p->J;
  const double q2 = x[0] + h / 2 * x[1], v2 = x[1] + h / 2 * a1, a2 = (push(p, t + h / 2, q2, v2) - slip * p->F) / p->J;
  const double q3 = x[0] + h / 2 * v2, v3 = x[1] + h / 2 * a2, a3 = (push(p, t + h / 2, q3, v3) - slip * p->F) / p->J;
  const double q4 = x[0] + h * v3, v4 = x[1] + h * a3, a4 = (push(p, t + h, q4, v4) - slip * p->F) / p->J;
  out[0] = x[0] + h / 6 * (x[1] + 2 * (v2 + v3) + v4);
  out[1] = x[1] + h / 6 * (a1 + 2 * (a2 + a3) + a4);
}

/* Positive where the mode is over: sliding against its direction, or pushed beyond the level. */
static double over(const law *p, double t, int slip, const double *x) {
  return slip ? -slip * x[1] : fabs(push(p, t, x[0], 0)) - p->F;
}

static void advance(const law *p, double t, double h, int slip, const double *x, double *out) {
  if (slip) step(p, t, h, slip, x, out);
  else { out[0] = x[0]; out[1] = 0; }
}

__attribute__((visibility("default"))) int64_t sliding(double J, double k, double d, double T, double f, double F,
                                                       int64_t rows, double h, double *y) {
  const law p = {J, k, d, T, 2 * 3.14159265358979323846 * f, F};
  double x[2] = {0, 0}, z[2];
  int slip = 0;
  int64_t events = 0;
  for (int64_t row = 0; row <= rows; row++) {
    y[row] = x[0];
    double t = (double)row * h, left = h;
    while (left > 1e-13 * h) {
      advance(&p, t, left, slip, x, z);
      double b = left;
      if (over(&p, t + left, slip, z) > 0) {
        double a = 0;
        while (b - a > 1e-13 * h) {
          const double middle = (a + b) / 2;
          advance(&p, t, middle, slip, x, z);
          if (over(&p, t + middle, slip, z) > 0) b = middle;
          else a = middle;
        }
        advance(&p, t, b, slip, x, z);
        if (slip) z[1] = 0;
        const double force = push(&p, t + b, z[0], 0);
        slip = fabs(force) > p.F ? (force > 0 ? 1 : -1) : 0;
        events++;
      }
      x[0] = z[0];
      x[1] = z[1];
      t += b;
      left -= b;
    }
  }
  return events;
}

typedef struct { double shared, m22, fixed, g1, g2, k, d; } rods;

static void swing(const rods *p, const double *x, double *r) {
  const double s2 = sin(x[1]), c = p->shared * cos(x[1]), s = p->shared * s2;
  const double m12 = p->m22 + c, m11 = p->fixed + 2 * c, pull = p->g2 * sin(x[0] + x[1]);
  const double f1 = s * (2 * x[2] * x[3] + x[3] * x[3]) - p->g1 * sin(x[0]) - pull - p->d * x[2];
  const double f2 = -s * x[2] * x[2] - pull - p->d * x[3] - p->k * x[1];
  const double size = 1 / (m11 * p->m22 - m12 * m12);
  r[0] = x[2];
  r[1] = x[3];
  r[2] = (p->m22 * f1 - m12 * f2) * size;
  r[3] = (m11 * f2 - m12 * f1) * size;
}

__attribute__((visibility("default"))) void two_links(double l1, double l2, double m1, double m2, double g, double k,
                                                      double d, double q1, double q2, int64_t rows, double h, double *y) {
  const double m22 = m2 * l2 * l2 / 3;
  const rods p = {m2 * l1 * l2 / 2, m22, m1 * l1 * l1 / 3 + m2 * l1 * l1 + m22, g * (m1 / 2 + m2) * l1, g * m2 * l2 / 2,
                  k, d};
  double x[4] = {q1, q2, 0, 0}, z[4], k1[4], k2[4], k3[4], k4[4];
  for (int64_t row = 0; row <= rows; row++) {
    y[row] = x[0];
    swing(&p, x, k1);
    for (int i = 0; i < 4; i++) z[i] = x[i] + h / 2 * k1[i];
    swing(&p, z, k2);
    for (int i = 0; i < 4; i++) z[i] = x[i] + h / 2 * k2[i];
    swing(&p, z, k3);
    for (int i = 0; i < 4; i++) z[i] = x[i] + h * k3[i];
    swing(&p, z, k4);
    for (int i = 0; i < 4; i++) x[i] += h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
  }
}
