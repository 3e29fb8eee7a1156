/* The truth simulator. Linear part: exact, by the matrix exponential of one short step (computed in Python). Forces that
 * are not linear: held over the step at their value in its middle (explicit midpoint, second order). Dry friction: a
 * set-valued law, solved for the end of each step, so that a stuck joint has velocity zero (Moreau's time stepping).
 *
 * x' = A x + B f,   f[0] = actuator, f[1..] = elements;   an element resists: f = -law(e, w), e and w linear in x.
 */
#include <math.h>
#include <string.h>

#define STATES 96
#define FORCES 24
#define SENSORS 6
#define PARAMETERS 12
#define MODES 4

enum { FRICTION, CONTACT, CUBIC, DRAG, GRAVITY, RIPPLE, VIBRATION, BOUC_WEN, WARM_UP, SERIES, STRANDS, END_STOP, OILED, MESH,
       MESH_INPUT };

/* What happens to the command: places in `input`. SLEW: fastest change (1/s). QUANTUM: step of the command. SAG: resistance
 * of the supply over that of the winding and the square of its voltage (1/V2). LOST: voltage that a dead time takes against
 * the current; KNEE: current above which all of it is taken (A), without inductance times the resistance of the winding (V);
 * CARRIED: whether there is an inductance, so that the current is the last state. HEAT...: rise of the resistance per kelvin,
 * resistance (ohm), heat capacity (J/K) and thermal resistance (K/W) of the winding, the same of the housing. */
enum { FORWARD, BACKWARD, OFFSET, LOW, HIGH, DEAD_LOW, DEAD_HIGH, LAG, DELAY, ROOM, EMF, SLEW, QUANTUM, SAG,
       LOST, KNEE, CARRIED, HEAT, WINDING, CAPACITY, INSULATION, HOUSING, COOLING };

typedef struct {
    int states, forces, elements, outputs, modes, substeps, samples, closed;
    double step, start;                          /* s; start: clock of the session when the record begins */
    const double *phi, *gamma, *phi_half, *gamma_half; /* states x states, states x forces */
    const double *C, *D;                         /* outputs x states, outputs x forces */
    const int *kind;                             /* per element; its force is f[1 + element] */
    const double *sense, *rate;                  /* elements x states: e and w */
    const double *parameter;                     /* elements x PARAMETERS */
    const double *load, *load_feed;              /* elements x states, elements: load on a friction, NULL if none */
    /* whirl: T = 1/2 w^2 a'Ha; angle speed row, its acceleration rows; forces follow those of the elements */
    const double *whirl_speed, *whirl_a, *whirl_b, *whirl_amplitude, *whirl_rate, *whirl_H;
    const double *input;                         /* see INPUTS */
    const double *turning;                       /* states: speed of the motor, where its winding matters */
    const double *sensor;                        /* outputs x (lag, scale, bias, rectified) */
    const double *series;                        /* samples + 1: disturbance of the SERIES element */
    const double *drift;                         /* samples x outputs: added to the sensors */
    const double *noise;                         /* samples x outputs: added before counting, seen by the loop */
    const double *quantum;                       /* outputs: 0 if the sensor does not count */
    const double *loop;                          /* sensor, kp, ki, kd, filter, limit, resolution */
    const double *reference;                     /* samples */
    const double *x0;
    double *command;                             /* samples: given, or written by the loop */
    double *clean, *measured;                    /* samples x outputs */
    double *trace;                               /* samples x states, or NULL */
} Plan;

static double dot(const double *a, const double *b, int n) {
    double s = 0;
    for (int i = 0; i < n; i++) s += a[i] * b[i];
    return s;
}

static double clip(double v, double low, double high) { return v < low ? low : v > high ? high : v; }

/* Sliding level of a friction element at speed w under a load, in the direction of `forward`. */
static double level(const double *p, double w, double load, double time, int forward) {
    double coulomb = p[forward ? 0 : 1], peak = p[forward ? 2 : 3], ratio = w / p[4];
    double warm = 1 + p[5] * exp(-time / p[6]);
    if (p[7] > 0) {
        double more = (p[7] + p[8] * fabs(load)) * fabs(load); /* p[8]: a share that grows with the load itself */
        coulomb += more, peak += more;
    }
    return warm * (coulomb + (peak - coulomb) * exp(-ratio * ratio));
}

/* Transmission error of a gear at the angle e of its input, which turns with w, and its rate; gives its slope. p: amplitude,
 * waves per radian and phase of each of three waves. A gear is at rest where a recording begins: there it errs by nothing. */
static double erring(const double *p, double e, double w, double *error, double *rate) {
    double slope = 0;
    *error = 0;
    for (int k = 0; k < 3; k++) {
        *error += p[3 * k] * (sin(p[3 * k + 1] * e + p[3 * k + 2]) - sin(p[3 * k + 2]));
        slope += p[3 * k] * p[3 * k + 1] * cos(p[3 * k + 1] * e + p[3 * k + 2]);
    }
    *rate = slope * w;
    return slope;
}

static double push(double k, double d, double p, double rate) {
    double force = k * p + d * rate;
    return p > 0 && force > 0 ? force : 0;
}

/* -law of element j at state x; z is its memory. Friction is not among them. */
static double effort(const Plan *P, int j, const double *x, double z, double time, int sample, double share) {
    const double *p = P->parameter + j * PARAMETERS;
    double e = dot(P->sense + j * P->states, x, P->states), w = dot(P->rate + j * P->states, x, P->states);
    switch (P->kind[j]) {
    case CONTACT: return push(p[0], p[1], -e - p[2], -w) - push(p[0], p[1], e - p[2], w);
    case CUBIC: return -p[0] * e * e * e;
    case DRAG: return -p[0] * fabs(w) * w;
    case GRAVITY: return -p[0] * sin(e - p[1]);
    case RIPPLE: return p[0] * sin(p[1] * e + p[2]);
    case VIBRATION: return p[0] * sin(p[1] * (time - P->start) + p[2]);
    case BOUC_WEN: return -p[0] * z;
    case WARM_UP: return -p[0] * exp(-time / p[1]) * w;
    case STRANDS: { /* a belt: each strand has its pretension and half of the stretch, and never pushes */
        double more = (p[0] * e + p[1] * w) / 2, half = p[0] * e / 2;
        return (half < p[2] ? p[2] - more : 0) - (half > -p[2] ? p[2] + more : 0);
    }
    case END_STOP: return push(p[0], p[1], p[2] - e, -w) - push(p[0], p[1], e - p[3], w);
    case OILED: return -p[0] * expm1(-p[1] * z) * w; /* the oil when cold damps as the matrices say */
    /* An elastic gear: stiffness p[0] and damping p[1] at its output, waves from p[2] on. MESH acts on its twist, beyond
     * what the matrices say of it, and the element after it on its input: a wave takes no power. */
    case MESH: {
        double error, rate, turned = dot(P->sense + (j + 1) * P->states, x, P->states);
        erring(p + 2, turned, dot(P->rate + (j + 1) * P->states, x, P->states), &error, &rate);
        return -p[0] * error - p[1] * rate;
    }
    case MESH_INPUT: {
        double error, rate, slope = erring(p + 2, e, w, &error, &rate);
        double twist = dot(P->sense + (j - 1) * P->states, x, P->states);
        double twisting = dot(P->rate + (j - 1) * P->states, x, P->states);
        return -slope * (p[0] * (twist + error) + p[1] * (twisting + rate));
    }
    case SERIES: return p[0] * ((1 - share) * P->series[sample] + share * P->series[sample + 1]);
    default: return 0;
    }
}

/* Temperature of an oil over its surroundings: what it damps warms it. p: damping when cold, share of it that a kelvin
 * takes, heat capacity (J/K), thermal resistance (K/W). */
static double heated(const double *p, double z, double w) {
    return (p[0] * exp(-p[1] * z) * w * w - z / p[3]) / p[2];
}

/* Bouc-Wen: z' = w - (b |w| z |z|^(q-1) + (1-b) w |z|^q) / zy^q */
static double flow(const double *p, double z, double w) {
    double knee = pow(fabs(z) / p[1], p[2]), sign = z < 0 ? -1.0 : 1.0;
    return w - knee * (p[3] * fabs(w) * sign + (1 - p[3]) * w);
}

/* Rate of the memory of element j, if it has one. */
static double memory(const Plan *P, int j, double z, const double *x) {
    const double *p = P->parameter + j * PARAMETERS;
    double w = dot(P->rate + j * P->states, x, P->states);
    return P->kind[j] == BOUC_WEN ? flow(p, z, w) : P->kind[j] == OILED ? heated(p, z, w) : 0;
}

/* All forces at x; f[0] and the friction forces are given. */
static void efforts(const Plan *P, const double *x, const double *z, double time, int sample, double share, double *f) {
    int n = P->states, first = 1 + P->elements;
    for (int j = 0; j < P->elements; j++)
        if (P->kind[j] != FRICTION) f[1 + j] = effort(P, j, x, z[j], time, sample, share);
    if (!P->modes) return;
    double w = dot(P->whirl_speed, x, n), a[MODES], v[MODES], Ha[MODES], added = 0, coriolis = 0;
    for (int i = 0; i < P->modes; i++) {
        a[i] = dot(P->whirl_amplitude + i * n, x, n);
        v[i] = dot(P->whirl_rate + i * n, x, n);
    }
    for (int i = 0; i < P->modes; i++) {
        Ha[i] = dot(P->whirl_H + i * P->modes, a, P->modes);
        added += a[i] * Ha[i];
        coriolis += 2 * w * v[i] * Ha[i];
        f[first + 1 + i] = w * w * Ha[i];
    }
    f[first] = 0;
    double free = dot(P->whirl_a, x, n) + dot(P->whirl_b, f, P->forces), b = P->whirl_b[first];
    f[first] = -coriolis - added * (free - b * coriolis) / (1 + b * added);
}

static void advance(const double *phi, const double *gamma, int n, int m, const double *x, const double *f, double *y) {
    for (int i = 0; i < n; i++) y[i] = dot(phi + i * n, x, n) + dot(gamma + i * m, f, m);
}

/* The command of a sample as it is sent: in steps, if the converter is coarse. */
static double sent(const Plan *P, int k) {
    double step = P->input[QUANTUM];
    return step > 0 ? step * floor(P->command[k] / step + 0.5) : P->command[k];
}

/* Mean of the delayed, held command over [t, t + h]. */
static double delayed(const Plan *P, double t, double h, double dt) {
    double from = t - P->input[DELAY], to = from + h, sum = 0;
    if (to <= 0) return 0;
    if (from < 0) from = 0;
    int k = (int)floor(from / dt + 1e-9), last = P->samples - 1;
    while (from < to - 1e-12 * dt) {
        double end = (k + 1) * dt < to ? (k + 1) * dt : to;
        sum += sent(P, k > last ? last : k) * (end - from);
        from = end, k++;
    }
    return sum / h;
}

/* The delayed, held command at the instant t, which an accelerometer feels. */
static double come(const Plan *P, double t, double dt) {
    int k = (int)floor((t - P->input[DELAY]) / dt + 1e-9), last = P->samples - 1;
    return k < 0 ? 0 : sent(P, k > last ? last : k);
}

static double shaped(const Plan *P, double u) {
    const double *p = P->input;
    u = u > 0 ? p[FORWARD] * u : p[BACKWARD] * u;
    u = clip(u + p[OFFSET], p[LOW], p[HIGH]);
    return u > p[DEAD_HIGH] ? u - p[DEAD_HIGH] : u < p[DEAD_LOW] ? u - p[DEAD_LOW] : 0;
}

/* What is left of `asked` where `lost` acts against it, up to `knee` in proportion to what is left. */
static double left(double asked, double lost, double knee) {
    double most = lost + knee;
    return fabs(asked) < most ? asked * knee / most : asked > 0 ? asked - lost : asked + lost;
}

/* What reaches the actuator. A bridge takes its share d = u / E of a bus whose voltage falls by the resistance of the supply
 * times d i, i = (voltage - emf) / R: solved for the voltage. A warm winding has more resistance: the cold one would need
 * less voltage for the same current. What a dead time takes is in proportion to the current, up to all of it: without
 * inductance what is left of the voltage solves drop + LOST * clip(drop / KNEE, -1, 1) = u - emf. An amplifier whose current has a limit gives no more than that current needs. */
static double driven(const Plan *P, double u, const double *x, double warmth) {
    const double *p = P->input;
    u = shaped(P, u);
    if (!(p[ROOM] > 0 || p[SAG] > 0 || p[HEAT] > 0 || p[LOST] > 0)) return u;
    double middle = p[EMF] * dot(P->turning, x, P->states), lost = p[SAG] * u * u;
    u = (u + lost * middle) / (1 + lost);
    if (p[LOST] > 0 && p[CARRIED] > 0) u -= p[LOST] * clip(x[P->states - 1] / p[KNEE], -1, 1);
    else if (p[LOST] > 0) u = middle + left(u - middle, p[LOST], p[KNEE]);
    if (p[HEAT] > 0) u = middle + (u - middle) / (1 + p[HEAT] * warmth);
    return p[ROOM] > 0 ? clip(u, middle - p[ROOM], middle + p[ROOM]) : u;
}

/* Temperatures of winding and housing over the surroundings after a step in which the current flows that a cold winding
 * draws from `voltage`. */
static void warmed(const Plan *P, double voltage, const double *x, double h, double *winding, double *housing) {
    const double *p = P->input;
    double current = (voltage - p[EMF] * dot(P->turning, x, P->states)) / p[WINDING];
    double heat = p[WINDING] * (1 + p[HEAT] * *winding) * current * current;
    double inward = (*winding - *housing) / p[INSULATION];
    *housing += h * (inward - *housing / p[COOLING]) / p[HOUSING];
    *winding += h * (heat - inward) / p[CAPACITY];
}

static double towards(double from, double to, double most) { return from + clip(to - from, -most, most); }

static double limited(double v, double limit, double resolution) {
    v = clip(v, -limit, limit);
    return resolution > 0 ? resolution * nearbyint(v / resolution) : v;
}

/* Friction forces such that the end of the step obeys the set-valued law. x holds the end without them. */
static void stick_or_slip(const Plan *P, double *x, const double *middle, double time, double *f, double *W) {
    int n = P->states, list[FORCES], count = 0;
    double speed[FORCES], up[FORCES], down[FORCES];
    for (int j = 0; j < P->elements; j++)
        if (P->kind[j] == FRICTION) {
            double w = dot(P->rate + j * n, middle, n);
            speed[count] = dot(P->rate + j * n, x, n);
            double load = P->load ? dot(P->load + j * n, middle, n) + P->load_feed[j] * f[0] : 0;
            up[count] = level(P->parameter + j * PARAMETERS, w, load, time, 1);
            down[count] = level(P->parameter + j * PARAMETERS, w, load, time, 0);
            f[1 + j] = 0;
            list[count++] = j;
        }
    for (int sweep = 0; sweep < 60; sweep++) {
        double moved = 0;
        for (int a = 0; a < count; a++) {
            double now = speed[a];
            for (int b = 0; b < count; b++)
                if (b != a) now += W[a * FORCES + b] * f[1 + list[b]];
            double next = clip(-now / W[a * FORCES + a], -up[a], down[a]);
            moved += fabs(next - f[1 + list[a]]);
            f[1 + list[a]] = next;
        }
        if (count < 2 || moved < 1e-14) break;
    }
    for (int a = 0; a < count; a++)
        for (int i = 0; i < n; i++) x[i] += P->gamma[i * P->forces + 1 + list[a]] * f[1 + list[a]];
}

int concealed_simulate(const Plan *P) {
    int n = P->states, m = P->forces, ny = P->outputs;
    if (n > STATES || m > FORCES || ny > SENSORS || P->modes > MODES) return 1;
    double x[STATES], middle[STATES], end[STATES], f[FORCES] = {0}, g[FORCES] = {0}, z[FORCES] = {0}, W[FORCES * FORCES];
    double seen[SENSORS], now_on[FORCES], h = P->step, dt = h * P->substeps, lagged = 0, slewed = 0, winding = 0, housing = 0, integral = 0, slope = 0, last = 0;
    double keep = P->input[LAG] > 0 ? exp(-h / P->input[LAG]) : 0, mean = P->input[LAG] > 0 ? P->input[LAG] / h * (1 - keep) : 0;
    int rubbing = 0, who[FORCES];
    for (int j = 0; j < P->elements; j++)
        if (P->kind[j] == FRICTION) who[rubbing++] = j;
    for (int a = 0; a < rubbing; a++)
        for (int b = 0; b < rubbing; b++) {
            W[a * FORCES + b] = 0;
            for (int i = 0; i < n; i++) W[a * FORCES + b] += P->rate[who[a] * n + i] * P->gamma[i * m + 1 + who[b]];
        }
    memcpy(x, P->x0, n * sizeof(double));
    for (int k = 0; k < P->samples; k++) {
        double t = k * dt;
        if (P->closed) P->command[k] = k ? P->command[k - 1] : 0; /* what acts until this sample has been read */
        double now_in = P->input[SLEW] > 0 ? slewed : come(P, t, dt);
        f[0] = driven(P, P->input[LAG] > 0 ? lagged : now_in, x, winding);
        efforts(P, x, z, P->start + t, k, 0, f);
        /* An accelerometer feels the friction of the instant that begins, not that of the step before: a jump of the
         * command does not move what sticks. */
        memcpy(now_on, f, m * sizeof(double));
        if (rubbing) {
            for (int a = 0; a < rubbing; a++) now_on[1 + who[a]] = 0;
            advance(P->phi, P->gamma, n, m, x, now_on, end);
            stick_or_slip(P, end, x, P->start + t, now_on, W);
        }
        for (int s = 0; s < ny; s++) {
            const double *c = P->sensor + 4 * s;
            double y = dot(P->C + s * n, x, n) + dot(P->D + s * m, now_on, m);
            if (k == 0 || c[0] <= 0) seen[s] = y;
            y = c[1] * seen[s] + c[2];
            if (c[3] != 0) y = fabs(y);
            y += P->drift[k * ny + s];
            P->clean[k * ny + s] = y;
            y += P->noise[k * ny + s];
            P->measured[k * ny + s] = P->quantum[s] > 0 ? P->quantum[s] * nearbyint(y / P->quantum[s]) : y;
        }
        if (P->trace) memcpy(P->trace + (size_t)k * n, x, n * sizeof(double));
        if (P->closed) {
            const double *c = P->loop;
            double y = P->measured[k * ny + (int)c[0]], error = P->reference[k] - y;
            if (k == 0) last = y;
            slope += (1 - exp(-dt / c[4])) * ((y - last) / dt - slope);
            last = y;
            integral += dt * error;
            P->command[k] = limited(c[1] * error + c[2] * integral - c[3] * slope, c[5], c[6]);
        }
        for (int i = 0; i < P->substeps; i++) {
            double now = P->start + t + i * h, share = (double)i / P->substeps, half = 0.5 / P->substeps;
            double u = delayed(P, t + i * h, h, dt);
            if (P->input[SLEW] > 0) {
                double before = slewed, moving;
                slewed = towards(slewed, u, P->input[SLEW] * h);
                moving = fabs(slewed - before) / P->input[SLEW]; /* the rest of the step it stands where it arrived */
                u = slewed + (before - slewed) / 2 * moving / h;
            }
            if (P->input[LAG] > 0) {
                double average = u + (lagged - u) * mean;
                lagged = u + (lagged - u) * keep;
                u = average;
            }
            f[0] = driven(P, u, x, winding);
            efforts(P, x, z, now, k, share, f);
            advance(P->phi_half, P->gamma_half, n, m, x, f, middle);
            double zm[FORCES];
            for (int j = 0; j < P->elements; j++)
                if (P->kind[j] == BOUC_WEN || P->kind[j] == OILED)
                    zm[j] = z[j] + h / 2 * memory(P, j, z[j], x);
                else if (P->kind[j] == FRICTION)
                    g[1 + j] = f[1 + j];
            if (P->input[LOST] > 0 && P->input[CARRIED] > 0) { /* the loss may be far stiffer than the winding: implicit */
                double most = P->gamma_half[(n - 1) * m] * P->input[LOST], knee = P->input[KNEE];
                middle[n - 1] = left(middle[n - 1] + most * clip(x[n - 1] / knee, -1, 1), most, knee);
            }
            g[0] = driven(P, u, middle, winding);
            if (P->input[HEAT] > 0) warmed(P, g[0], middle, h, &winding, &housing);
            efforts(P, middle, zm, now + h / 2, k, share + half, g);
            for (int j = 0; j < P->elements; j++)
                if (P->kind[j] == BOUC_WEN || P->kind[j] == OILED)
                    z[j] += h * memory(P, j, zm[j], middle);
                else if (P->kind[j] == FRICTION)
                    g[1 + j] = 0;
            advance(P->phi, P->gamma, n, m, x, g, end);
            if (rubbing) stick_or_slip(P, end, middle, now + h / 2, g, W);
            for (int s = 0; s < ny; s++) {
                double lag = P->sensor[4 * s];
                if (lag <= 0) continue;
                double before = dot(P->C + s * n, x, n) + dot(P->D + s * m, f, m);
                double after = dot(P->C + s * n, end, n) + dot(P->D + s * m, g, m);
                double slip = lag * (after - before) / h; /* exact where the signal is a straight line */
                seen[s] = after - slip + (seen[s] - before + slip) * exp(-h / lag);
            }
            memcpy(x, end, n * sizeof(double));
            memcpy(f, g, m * sizeof(double));
        }
        if (!(dot(x, x, n) < 1e12)) return 2;
    }
    return 0;
}
