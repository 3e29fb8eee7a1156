/* Reference model B, written by hand: model A cut at the gear's output by push-only backlash, with friction that sticks
 * at the rotor, a dead zone before the motor, and a PI controller sampled at 1 kHz. Referred to the gear's output, with
 * w1 the speed before the backlash, theta, w the hub, a_i the modes, b_i their speeds, y the filtered tachometer:
 *
 *   J1 w1' = eta_g n (eta_m kt (V - km n w1) / R - Bm n w1 - s F(n w1)) - tau,    F(v) = Fc + (Fs - Fc) exp(-(v/vs)^2)
 *   (J + m sum a_i^2) w' + sum c_i b_i' = tau - B w - 2 m w sum a_i b_i
 *   c_i w' + m b_i' = -K_i a_i - D_i b_i + m a_i w^2
 *   tau = k (e -+ g) + d e' in contact, e = theta1 - theta;    y' = wc (S n w1 - y)
 *
 * s = +-1 slips and ends where s w1 < 0; s = 0 sticks until the torque on the rotor exceeds eta_g n Fs. An open gap
 * closes where p > 0 and k p + d p' > 0; a contact opens where k p + d p' < 0. Switches are located to 1e-13 of a step
 * and lie behind the crossing. The dead zone's kinks are met only at samples, because the command is held. */

#include <math.h>
#include <stdint.h>

#define N 13 /* theta1, theta, a[4], w1, w, b[4], y */
enum { W1 = 6, W = 7 };
static const double PI = 3.14159265358979323846;

static const double beta[4] = {1.8751040687119611, 4.694091132974174, 7.854757438237613, 10.995540734875467};
static const double stiffness = 20, damping = 0.02, gap = 2e-3, bearing = 0.004, m = 65e-3, n = 70;
static const double kp = 3, ki = 40, T = 1e-3, lower = -0.09, upper = 0.18, scale = 1.0026761414789406;

typedef struct {
  double drive, brake, inverse, slide, excess, hold, width, J, corner, tacho, k[4], d[4], r[4], c[4], tip[4];
} constants;

typedef struct { double x[N], V; int slip, contact, zone; int64_t events; } state;

static constants prepare(void) {
  const double R = 2.6, kt = 7.68e-3, km = 7.68e-3, motor = 0.69, Jm = 4.606e-7, gear = 0.9, Jg = 4.8754e-5;
  const double Fc = 2.25e-4, Fs = 3.4e-4, vs = 2, Bm = 1.26e-6, L = 0.419, EI = 0.137422, Jh = 3e-4, xi = 0.01;
  constants c;
  c.drive = gear * n * motor * kt / R;
  c.brake = c.drive * km * n + gear * n * Bm * n;
  c.inverse = 1 / (gear * n * n * Jm + Jg);
  c.slide = gear * n * Fc;
  c.excess = gear * n * (Fs - Fc);
  c.hold = gear * n * Fs;
  c.width = n / vs;
  c.corner = 2 * PI * 10;
  c.tacho = 1.5e-3 * 60 / (2 * PI) * n;
  c.J = Jh + m * L * L / 3;
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

/* Velocity of a motion over 2.4 rad in 2 s that meets all four limits: eight pieces of snap +-76.8, 0.25 s each. */
static double velocity(double t) {
  static const double snap[8] = {1, -1, -1, 1, -1, 1, 1, -1};
  if (t <= 0 || t >= 2) return 0;
  double v = 0, a = 0, j = 0;
  for (int i = 0; i < 8; i++) {
    const double s = 76.8 * snap[i], left = t - 0.25 * i, h = left < 0.25 ? left : 0.25;
    v += h * (a + h * (j / 2 + h * s / 6));
    a += h * (j + h * s / 2);
    j += h * s;
    if (left <= 0.25) break;
  }
  return v;
}

static inline double load(const double *x, int contact) {
  return contact ? stiffness * (x[0] - x[1] - contact * gap) + damping * (x[W1] - x[W]) : 0;
}

static inline void derivative(const constants *c, const double *restrict x, const state *s, double *restrict r) {
  const double w1 = x[W1], w = x[W], w2 = w * w, tau = load(x, s->contact);
  double friction = 0, torque = tau - bearing * w, squares = 0, powers = 0;
  if (s->slip) friction = s->slip * (c->slide + c->excess * exp(-(c->width * w1) * (c->width * w1)));
  r[0] = w1;
  r[1] = w;
  r[W1] = s->slip ? c->inverse * (c->drive * s->V - c->brake * w1 - tau - friction) : 0;
  for (int i = 0; i < 4; i++) {
    const double a = x[2 + i], b = x[8 + i], f = a * w2 - c->k[i] * a - c->d[i] * b;
    r[8 + i] = f;
    r[2 + i] = b;
    torque -= c->c[i] * f;
    squares += a * a;
    powers += a * b;
  }
  const double turning = (torque - 2 * m * w * powers) / (c->J + m * squares);
  r[W] = turning;
  for (int i = 0; i < 4; i++) r[8 + i] -= c->r[i] * turning;
  r[12] = c->corner * (c->tacho * w1 - x[12]);
}

typedef struct { double friction, contact; int to_slip, to_contact; } guards;

/* Positive where a mode is over; to_... is what follows it. */
static inline guards watch(const constants *c, const double *x, const state *s) {
  guards g = {0, 0, 0, 0};
  if (s->slip) g.friction = -s->slip * x[W1];
  else {
    const double push = c->drive * s->V - c->brake * x[W1] - load(x, s->contact);
    g.friction = fabs(push) - c->hold;
    g.to_slip = push > 0 ? 1 : -1;
  }
  if (s->contact) g.contact = -s->contact * load(x, s->contact);
  else {
    const double e = x[0] - x[1];
    g.to_contact = e > 0 ? 1 : -1;
    const double p = g.to_contact * e - gap, force = g.to_contact * load(x, g.to_contact);
    g.contact = p < force ? p : force;
  }
  return g;
}

/* Switch until no guard is violated; a sliding rotor stops before it may start the other way. */
static inline void settle(const constants *c, state *s) {
  for (;;) {
    const guards g = watch(c, s->x, s);
    if (!(g.friction > 0 || g.contact > 0)) return;
    const int slipping = s->slip, touching = g.contact > 0;
    if (touching) s->contact = g.to_contact;
    if (g.friction > 0 && (slipping || !touching)) {
      if (slipping) s->x[W1] = 0;
      s->slip = g.to_slip;
    }
    s->events++;
  }
}

static inline void rk4(const constants *c, const state *s, const double *k1, double h, double *x) {
  double k2[N], k3[N], k4[N], z[N];
  for (int i = 0; i < N; i++) z[i] = s->x[i] + h / 2 * k1[i];
  derivative(c, z, s, k2);
  for (int i = 0; i < N; i++) z[i] = s->x[i] + h / 2 * k2[i];
  derivative(c, z, s, k3);
  for (int i = 0; i < N; i++) z[i] = s->x[i] + h * k3[i];
  derivative(c, z, s, k4);
  for (int i = 0; i < N; i++) x[i] = s->x[i] + h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
}

static inline double worst(const constants *c, const double *x, const state *s) {
  const guards g = watch(c, x, s);
  return g.friction > g.contact ? g.friction : g.contact;
}

static void step(const constants *c, state *s, double h) {
  double left = h;
  for (int tries = 0; tries < 200; tries++) {
    double k1[N], x[N];
    derivative(c, s->x, s, k1);
    rk4(c, s, k1, left, x);
    double over = worst(c, x, s);
    if (!(over > 0)) {
      for (int i = 0; i < N; i++) s->x[i] = x[i];
      return;
    }
    /* Illinois between the start, where no guard is violated, and the end, where one is. */
    double a = 0, b = left, under = worst(c, s->x, s);
    for (int turn = 0, side = 0; turn < 120 && b - a > 1e-13 * h; turn++) {
      double t = turn % 4 < 3 && under < 0 ? b - over * (b - a) / (over - under) : (a + b) / 2, z[N];
      if (t < a + 5e-14 * h) t = a + 5e-14 * h;
      if (t > b - 5e-14 * h) t = b - 5e-14 * h;
      rk4(c, s, k1, t, z);
      const double now = worst(c, z, s);
      if (now > 0) {
        b = t; over = now;
        if (side > 0) under /= 2;
        side = 1;
        for (int i = 0; i < N; i++) x[i] = z[i];
      } else {
        a = t; under = now;
        if (side < 0) over /= 2;
        side = -1;
      }
    }
    for (int i = 0; i < N; i++) s->x[i] = x[i];
    settle(c, s);
    left -= b;
    if (left <= 1e-13 * h) return;
  }
}

static void record(const constants *c, const state *s, double command, double *y) {
  double deflection = 0;
  for (int i = 0; i < 4; i++) deflection += c->tip[i] * s->x[2 + i];
  y[0] = command;
  y[1] = s->V;
  y[2] = n * s->x[W1];
  y[3] = load(s->x, s->contact);
  y[4] = s->x[1];
  y[5] = s->x[W];
  y[6] = deflection;
}

/* rows outputs 1 ms apart after the first, parts steps of RK4 between two; y: command, voltage, motor speed, contact
 * torque, angle, speed, tip. Returns the number of switches. */
__attribute__((visibility("default"))) int reference(int64_t rows, int64_t parts, double *y) {
  const constants c = prepare();
  state s = {0};
  double integral = 0;
  for (int64_t k = 0; k <= rows; k++) {
    if (k) for (int64_t part = 0; part < parts; part++) step(&c, &s, T / (double)parts);
    const double t = (double)k * T, error = scale * (velocity(t - 0.5) - velocity(t - 5)) - s.x[12];
    const double command = kp * error + ki * integral;
    integral += T * error;
    const int zone = command > upper ? 1 : command < lower ? -1 : 0;
    s.events += zone != s.zone;
    s.zone = zone;
    s.V = zone > 0 ? command - upper : zone < 0 ? command - lower : 0;
    settle(&c, &s);
    record(&c, &s, command, y + 7 * k);
  }
  return (int)s.events;
}
