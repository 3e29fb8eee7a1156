/* What Python calls: one whole simulation, without touching Python while it runs. */

typedef struct {
  const double *p, *x0, *d0, *m0;          /* m0: not finite where the run is to decide */
  double t0, resolution, hmax;             /* seconds; instants are t0 + tick * resolution */
  int64_t outputs; const int64_t *rows;    /* rows after the first, and the ticks of all rows */
  const int64_t *period, *offset;          /* clocks, in ticks */
  const int64_t *stage;                    /* what is read of delay lines, in instants of their clocks */
  int64_t knots;                           /* rows of the driven inputs */
  const int64_t *knot; const double *value; const int32_t *linear;
  double *y, *states, *modes;              /* rows of outputs; states and modes may be NULL */
  double *x1, *d1, *m1;                    /* at the end */
  double *log; int64_t log_capacity;
  int64_t log_length, steps, events, row;  /* row doubles as progress */
  const volatile int32_t *cancel;
  int32_t status, culprit;
  double t1;
  int32_t (*external)(int32_t which, double t, const double *in, double *out); /* not 0: it failed */
  const void *code;                        /* the model, to code that serves all of them; see bytecode.c */
} fa_job;

enum { FA_EXTERNAL = 5 };

#ifndef FA_ON_RECORD
#define FA_ON_RECORD(s, row)
#endif
#define FA_EXPORT __attribute__((visibility("default")))

static void fa_drive_inputs(fa_sim *s, const fa_job *job, int64_t k) {
  for (int i = 0; i < FA_NU; i++) {
    const double here = job->value[k * FA_NU + i];
    double slope = 0;
    if (job->linear[i] && k + 1 < job->knots) {
      const double span = (double)(job->knot[k + 1] - job->knot[k]) * job->resolution;
      slope = (job->value[(k + 1) * FA_NU + i] - here) / span;
    }
    fa_set_input(s, i, here, slope);
  }
}

static void fa_record(const fa_sim *s, fa_job *job, int64_t row) {
  fa_read_outputs(s, job->y + row * FA_NY);
  FA_ON_RECORD(s, row);
  if (job->states) memcpy(job->states + row * FA_NX, s->x, sizeof(double) * FA_NX);
  if (job->modes) memcpy(job->modes + row * FA_NM, s->m, sizeof(double) * FA_NM);
  job->row = row + 1;
}

#if FA_NE
/* Call the external functions whose clock ticks; each may be given what those before it returned. */
static int fa_externals(fa_sim *s, const fa_job *job, double *fire) {
  double u[FA_SIZE(FA_NI)], in[FA_SIZE(FA_NEI)];
  fa_inputs(s, s->t, u);
  for (int k = 0; k < FA_NE; k++) {
    if (fire[fa_external_clock[k]] == 0) continue;
    fa_external(s->t, s->x, u, s->d, s->m, s->p, s->cp, s->cm, fire, in);
    double *out = fire + FA_NC + fa_external_first_output[k];
    if (job->external(k, s->t, in + fa_external_first_input[k], out)) {
      s->culprit = k;
      return s->status = FA_EXTERNAL;
    }
  }
  return FA_OK;
}
#endif

/* due: the next tick of each clock. */
static int fa_clocks(fa_sim *s, const fa_job *job, int64_t tick, int64_t *due) {
  double fire[FA_SIZE(FA_NC + FA_NEO)];
  int any = 0;
  memset(fire, 0, sizeof fire);
  for (int c = 0; c < FA_NC; c++) {
    if (due[c] != tick) continue;
    due[c] += job->period[c];
    fire[c] = any = 1;
  }
#if FA_NE
  if (any && fa_externals(s, job, fire)) return s->status;
#endif
  return any ? fa_tick(s, fire) : FA_OK;
}

/* The tick up to which nothing but the model itself happens; due: the next tick of each clock. */
static int64_t fa_next_tick(const fa_sim *s, const fa_job *job, int64_t row, int64_t knot, const int64_t *due) {
  (void)s;
  int64_t tick = job->rows[row + 1];
  for (int c = 0; c < FA_NC; c++) if (due[c] < tick) tick = due[c];
  if (FA_NU && knot < job->knots && job->knot[knot] < tick) tick = job->knot[knot];
  return tick;
}

static int fa_run(fa_sim *s, fa_job *job) {
  const int64_t last = job->rows[job->outputs];
  int64_t tick = 0, knot = 0, row = 0, due[FA_SIZE(FA_NC)];
  for (int c = 0; c < FA_NC; c++) due[c] = job->offset[c];
  if (FA_NU) while (knot < job->knots && job->knot[knot] <= 0) fa_drive_inputs(s, job, knot++);
  if (fa_start(s) || fa_clocks(s, job, 0, due)) return s->status;
  fa_record(s, job, 0);
  while (tick < last) {
    tick = fa_next_tick(s, job, row, knot, due);
    if (fa_integrate_to(s, job->t0 + (double)tick * job->resolution)) return s->status;
    int driven = 0;
    if (FA_NU) while (knot < job->knots && job->knot[knot] <= tick) { fa_drive_inputs(s, job, knot++); driven = 1; }
    if (driven && fa_settle(s)) return s->status;
    if (fa_clocks(s, job, tick, due)) return s->status;
    if (tick == job->rows[row + 1]) fa_record(s, job, ++row);
  }
  return fa_update_derivative(s);
}

/* Nothing known yet; delay lines, which are large and seldom used, are filled when the run starts. */
static void fa_clear(fa_sim *s) { memset(s, 0, (size_t)((char *)s->line - (char *)s)); }

static void fa_take(fa_sim *s, const fa_job *job) {
  s->t = job->t0;
  s->hmax = job->hmax;
  memcpy(s->x, job->x0, sizeof(double) * FA_NX);
  memcpy(s->d, job->d0, sizeof(double) * FA_ND);
  memcpy(s->m, job->m0, sizeof(double) * FA_NM);
  memcpy(s->p, job->p, sizeof(double) * FA_NP);
  s->log = job->log;
  s->log_capacity = job->log_capacity;
  s->stage = job->stage;
  s->cancel = job->cancel;
}

static void fa_give(const fa_sim *s, fa_job *job) {
  memcpy(job->x1, s->x, sizeof(double) * FA_NX);
  memcpy(job->d1, s->d, sizeof(double) * FA_ND);
  memcpy(job->m1, s->m, sizeof(double) * FA_NM);
  job->steps = s->steps;
  job->events = s->events;
  job->log_length = s->log_length;
  job->status = s->status;
  job->culprit = s->culprit;
  job->t1 = s->t;
}

FA_EXPORT int fa_simulate(fa_job *job, void *listener) {
  fa_sim sim, *s = &sim;
  fa_clear(s);
#ifdef FA_BYTECODE
  s->code = job->code;
  double file[s->code->registers];
  s->file = fa_filled(s->code, file);
#endif
  fa_take(s, job);
  s->listener = listener;
  fa_run(s, job);
  fa_give(s, job);
  return s->status;
}
