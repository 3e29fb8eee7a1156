/* The 8-state reference arm written by hand: DC motor, gear with losses, bearing and a nonlinear flexible link with three
 * assumed modes and a payload; the classical Runge-Kutta method of fourth order at a fixed step. Nothing is generated.
 * As in the FMU every parameter can be changed between steps.
 *
 * With the angle theta of the hub, w = theta', amplitudes a_i of the clamped-free modes, q_i their values at the tip, and
 * z = sum q_i a_i the deflection of the tip,
 *
 *   (eta_g n^2 J_m + J_g + (m / 3 + mp) L^2 + m sum a_i^2 + mp z^2) w' + sum c_i a_i'' + 2 w (m sum a_i a_i' + mp z z')
 *       = eta_g n tau - b w
 *   c_i w' + m a_i'' + mp q_i z'' - w^2 (m a_i + mp z q_i) + d_i a_i' + k_i a_i = 0
 *   tau = eta_m k_t (V - k_e n w) / R,   c_i = 2 m L / beta_i^2 + mp L q_i,   k_i = EI beta_i^4 / L^3,
 *   d_i = 2 xi sqrt(k_i (m + 4 mp))
 *
 * The modal mass m 1 + mp q q' is inverted by the formula of Sherman and Morrison.
 * State: theta, a_1, a_2, a_3, w, a_1', a_2', a_3'. */

#include <math.h>

#define MODES 3
#define STATES 8

typedef struct {
  double resistance, torque_constant, back_emf_constant, motor_efficiency, rotor_inertia, ratio, gear_efficiency,
      gear_inertia, drag, length, mass, rigidity, damping_ratio, payload;
} arm8_parameters;

static const double tip[MODES] = {2, -2, 2};
static arm8_parameters par;
static double coupling[MODES], stiffness[MODES], damping[MODES], solved[MODES], inertia, gain, back, share;

/* x = (m 1 + mp q q')^-1 f */
static inline void solve(const double *f, double *x) {
  const double common = share * (f[0] - f[1] + f[2]);
  for (int i = 0; i < MODES; i++) x[i] = (f[i] - common * tip[i]) / par.mass;
}

/* Roots of cos b cosh b = -1, and what follows from them. */
void arm8_prepare(const arm8_parameters *given) {
  par = *given;
  const double m = par.mass, mp = par.payload, L = par.length;
  share = 2 * mp / (m + 12 * mp);
  gain = par.gear_efficiency * par.ratio * par.motor_efficiency * par.torque_constant / par.resistance;
  back = par.back_emf_constant * par.ratio;
  inertia = par.gear_efficiency * par.ratio * par.ratio * par.rotor_inertia + par.gear_inertia + (m / 3 + mp) * L * L;
  for (int i = 0; i < MODES; i++) {
    double b = (i + 0.5) * acos(-1);
    for (int turn = 0; turn < 60; turn++)
      b -= (cos(b) * cosh(b) + 1) / (cos(b) * sinh(b) - sin(b) * cosh(b));
    coupling[i] = 2 * m * L / (b * b) + mp * L * tip[i];
    stiffness[i] = par.rigidity * b * b * b * b / (L * L * L);
    damping[i] = 2 * par.damping_ratio * sqrt(stiffness[i] * (m + 4 * mp));
  }
  solve(coupling, solved);
  for (int i = 0; i < MODES; i++) inertia -= coupling[i] * solved[i];
}

static void rates(const double *x, double voltage, double *dx) {
  const double w = x[4], *a = x + 1, *v = x + 5, m = par.mass, mp = par.payload;
  const double z = 2 * (a[0] - a[1] + a[2]), rate = 2 * (v[0] - v[1] + v[2]);
  double held = inertia + mp * z * z, moved = mp * z * rate, pulled = 0, force[MODES], acceleration[MODES];
  for (int i = 0; i < MODES; i++) {
    force[i] = w * w * (m * a[i] + mp * z * tip[i]) - stiffness[i] * a[i] - damping[i] * v[i];
    held += m * a[i] * a[i];
    moved += m * a[i] * v[i];
    pulled += solved[i] * force[i];
  }
  const double turning = (gain * (voltage - back * w) - par.drag * w - 2 * w * moved - pulled) / held;
  solve(force, acceleration);
  dx[0] = w;
  dx[4] = turning;
  for (int i = 0; i < MODES; i++) {
    dx[1 + i] = v[i];
    dx[5 + i] = acceleration[i] - solved[i] * turning;
  }
}

void arm8_run(double *x, double voltage, double h, long steps) {
  double k1[STATES], k2[STATES], k3[STATES], k4[STATES], y[STATES];
  for (long k = 0; k < steps; k++) {
    rates(x, voltage, k1);
    for (int i = 0; i < STATES; i++) y[i] = x[i] + h / 2 * k1[i];
    rates(y, voltage, k2);
    for (int i = 0; i < STATES; i++) y[i] = x[i] + h / 2 * k2[i];
    rates(y, voltage, k3);
    for (int i = 0; i < STATES; i++) y[i] = x[i] + h * k3[i];
    rates(y, voltage, k4);
    for (int i = 0; i < STATES; i++) x[i] += h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
  }
}

/* Angle of the hub, deflection of the tip, acceleration of the tip, current. */
void arm8_outputs(const double *x, double voltage, double *out) {
  double dx[STATES];
  rates(x, voltage, dx);
  out[0] = x[0];
  out[1] = 2 * (x[1] - x[2] + x[3]);
  out[2] = par.length * dx[4] + 2 * (dx[5] - dx[6] + dx[7]);
  out[3] = (voltage - back * x[4]) / par.resistance;
}
