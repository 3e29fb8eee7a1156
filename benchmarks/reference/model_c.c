/* Reference model C, written by hand: two links hinged in the horizontal plane, each bending in two clamped-free modes.
 * With q1, q2 the joints, a, b the amplitudes of the links, y1 and z1 deflection and slope of the first tip, the root of
 * link 2 turns with w = q1' + z1' + q2' and accelerates, in axes turned from link 1 by z1 + q2, with the components of
 *
 *   (-y1 q1'' - L q1'^2 - 2 q1' y1',   L q1'' + y1'' - y1 q1'^2)
 *
 * called (A, B) below. What a link needs at its root and in its modes, with P = sum P_j b_j and Q = m sum b_j^2:
 *
 *   Fu = m A - P w' - 2 P' w - S w^2               Fw = (I + Q) w' + S B - P A + sum h_j b_j'' + Q' w
 *   Fv = m B + S w' + sum P_j b_j'' - P w^2        Fj = P_j B + h_j w' + m b_j'' - m b_j w^2
 *
 * and for link 1, with its payload in m_jk = m + mp Q_j Q_k and a fixed root, Fw and Fj with A = B = 0. Virtual power
 * gives the symmetric mass matrix of (q1'', q2'', a'', b''); b'' is eliminated first, the rest by Cholesky's method. */

#include <math.h>
#include <stdint.h>

#define N 12 /* q1, q2, a[2], b[2] and their rates */
static const double PI = 3.14159265358979323846;
static const double L1 = 0.24, m1 = 19.992e-3, payload = 0.21, L2 = 0.19, m2 = 20.007e-3, EI = 0.05, hub = 5e-5;
static const double viscous = 1e-3, xi = 0.01;
static const double beta[2] = {1.8751040687119611, 4.694091132974174}, tip[2] = {2, -2};

typedef struct {
  double I1, I2, S2, mass1[2][2], h1[2], slope[2], k1[2], d1[2]; /* link 1; slope: z1 per amplitude */
  double P2[2], h2[2], k2[2], d2[2], inverse;                    /* link 2 */
} constants;

static constants prepare(void) {
  constants c;
  c.I1 = hub + L1 * L1 * (m1 / 3 + payload);
  c.I2 = hub + L2 * L2 * m2 / 3;
  c.S2 = L2 * m2 / 2;
  c.inverse = 1 / m2;
  for (int j = 0; j < 2; j++) {
    const double b = beta[j], sigma = (cosh(b) + cos(b)) / (sinh(b) + sin(b)), b4 = b * b * b * b;
    for (int k = 0; k < 2; k++) c.mass1[j][k] = payload * tip[j] * tip[k] + (j == k ? m1 : 0);
    c.h1[j] = L1 * (m1 * 2 / (b * b) + payload * tip[j]);
    c.slope[j] = tip[j] * sigma * b / L1;
    c.k1[j] = EI / (L1 * L1 * L1) * b4;
    c.d1[j] = 2 * xi * sqrt(c.k1[j] * c.mass1[j][j]);
    c.P2[j] = m2 * 2 * sigma / b;
    c.h2[j] = L2 * m2 * 2 / (b * b);
    c.k2[j] = EI / (L2 * L2 * L2) * b4;
    c.d2[j] = 2 * xi * sqrt(c.k2[j] * m2);
  }
  return c;
}

typedef struct { double one, two; } torques;

static torques drive(double t) {
  return (torques){12e-3 * sin(2 * PI * 0.6 * t), 2e-3 * sin(2 * PI * 0.9 * t)};
}

static inline void derivative(const constants *c, const double *restrict x, torques tau, double *restrict r) {
  const double *a = x + 2, *b = x + 4, *v = x + 6, *da = x + 8, *db = x + 10;
  const double w1 = v[0], w1w1 = w1 * w1;
  const double y1 = tip[0] * a[0] + tip[1] * a[1], dy1 = tip[0] * da[0] + tip[1] * da[1];
  const double w = w1 + v[1] + c->slope[0] * da[0] + c->slope[1] * da[1], ww = w * w;
  const double turned = x[1] + c->slope[0] * a[0] + c->slope[1] * a[1], cosine = cos(turned), sine = sin(turned);

  /* How A, B and w' follow from (q1'', q2'', a''), and what they are without them. */
  const double U[4] = {sine * L1 - cosine * y1, 0, sine * tip[0], sine * tip[1]};
  const double V[4] = {sine * y1 + cosine * L1, 0, cosine * tip[0], cosine * tip[1]};
  const double W[4] = {1, 1, c->slope[0], c->slope[1]};
  const double ax = -L1 * w1w1 - 2 * w1 * dy1, ay = -y1 * w1w1;
  const double A = cosine * ax + sine * ay, B = cosine * ay - sine * ax;

  const double P = c->P2[0] * b[0] + c->P2[1] * b[1], dP = c->P2[0] * db[0] + c->P2[1] * db[1];
  const double E = c->I2 + m2 * (b[0] * b[0] + b[1] * b[1]), dQ = 2 * m2 * (b[0] * db[0] + b[1] * db[1]);
  const double Fu = m2 * A - 2 * dP * w - c->S2 * ww, Fv = m2 * B - P * ww, Fw = c->S2 * B - P * A + dQ * w;
  const double s0 = c->mass1[0][0] * a[0] + c->mass1[0][1] * a[1], s1 = c->mass1[1][0] * a[0] + c->mass1[1][1] * a[1];

  double M[4][4], f[4], C[4][2], g[2];
  f[0] = tau.one - viscous * v[0] - 2 * (s0 * da[0] + s1 * da[1]) * w1;
  f[1] = tau.two - viscous * v[1];
  f[2] = s0 * w1w1 - c->k1[0] * a[0] - c->d1[0] * da[0];
  f[3] = s1 * w1w1 - c->k1[1] * a[1] - c->d1[1] * da[1];
  for (int j = 0; j < 2; j++)
    g[j] = c->inverse * (m2 * b[j] * ww - c->P2[j] * B - c->k2[j] * b[j] - c->d2[j] * db[j]);
  for (int i = 0; i < 4; i++) {
    f[i] -= U[i] * Fu + V[i] * Fv + W[i] * Fw;
    for (int j = 0; j < 2; j++) {
      C[i][j] = c->P2[j] * V[i] + c->h2[j] * W[i];
      f[i] -= C[i][j] * g[j];
    }
    const double mu = m2 * U[i] - P * W[i], mv = m2 * V[i] + c->S2 * W[i], mw = E * W[i] + c->S2 * V[i] - P * U[i];
    for (int j = 0; j <= i; j++)
      M[i][j] = mu * U[j] + mv * V[j] + mw * W[j] - c->inverse * (C[i][0] * C[j][0] + C[i][1] * C[j][1]);
  }
  M[0][0] += c->I1 + s0 * a[0] + s1 * a[1];
  M[2][0] += c->h1[0];
  M[3][0] += c->h1[1];
  M[2][2] += c->mass1[0][0];
  M[3][2] += c->mass1[1][0];
  M[3][3] += c->mass1[1][1];

  /* L D L' in place: M[i][j] becomes L, D is kept by its reciprocal. */
  double D[4];
  for (int i = 0; i < 4; i++) {
    double d = M[i][i];
    for (int j = 0; j < i; j++) {
      double s = M[i][j];
      for (int k = 0; k < j; k++) s -= M[i][k] * M[j][k];
      M[i][j] = s;
    }
    for (int j = 0; j < i; j++) {
      const double l = M[i][j] * D[j];
      d -= l * M[i][j];
      f[i] -= l * f[j];
    }
    for (int j = 0; j < i; j++) M[i][j] *= D[j];
    D[i] = 1 / d;
  }
  for (int i = 3; i >= 0; i--) {
    f[i] *= D[i];
    for (int j = i + 1; j < 4; j++) f[i] -= M[j][i] * f[j];
  }

  for (int i = 0; i < 6; i++) r[i] = v[i];
  for (int i = 0; i < 4; i++) r[6 + i] = f[i];
  for (int j = 0; j < 2; j++) {
    double s = 0;
    for (int i = 0; i < 4; i++) s += C[i][j] * f[i];
    r[10 + j] = g[j] - c->inverse * s;
  }
}

static void record(const constants *c, const double *x, double *y) {
  const double y1 = tip[0] * x[2] + tip[1] * x[3], y2 = tip[0] * x[4] + tip[1] * x[5];
  const double second = x[0] + x[1] + c->slope[0] * x[2] + c->slope[1] * x[3];
  y[0] = x[0];
  y[1] = x[1];
  y[2] = y1;
  y[3] = y2;
  y[4] = L1 * cos(x[0]) - y1 * sin(x[0]) + L2 * cos(second) - y2 * sin(second);
  y[5] = L1 * sin(x[0]) + y1 * cos(x[0]) + L2 * sin(second) + y2 * cos(second);
}

/* rows outputs 1 ms apart after the first, parts steps of RK4 between two; y: joint angles, deflections, tip. */
__attribute__((visibility("default"))) int reference(int64_t rows, int64_t parts, double *y) {
  const constants c = prepare();
  double x[N] = {0}, k1[N], k2[N], k3[N], k4[N], z[N];
  const double h = 1e-3 / (double)parts;
  record(&c, x, y);
  for (int64_t k = 0; k < rows; k++) {
    for (int64_t part = 0; part < parts; part++) {
      const double t = (double)k * 1e-3 + (double)part * h;
      const torques middle = drive(t + h / 2);
      derivative(&c, x, drive(t), k1);
      for (int i = 0; i < N; i++) z[i] = x[i] + h / 2 * k1[i];
      derivative(&c, z, middle, k2);
      for (int i = 0; i < N; i++) z[i] = x[i] + h / 2 * k2[i];
      derivative(&c, z, middle, k3);
      for (int i = 0; i < N; i++) z[i] = x[i] + h * k3[i];
      derivative(&c, z, drive(t + h), k4);
      for (int i = 0; i < N; i++) x[i] += h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
    }
    record(&c, x, y + 6 * (k + 1));
  }
  return 0;
}
