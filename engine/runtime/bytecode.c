/* Models as byte code, for runs that are over before a compiler would have begun: this stands where the generated code of
 * one model would, and serves every model whose sizes are within FA_MOST and FA_MOST_LINE.
 *
 * A model's values lie in one file: t, x, u, d, m, p, fire, then constants, then the result of every operation, each in a
 * place of its own. What depends on parameters or modes alone is worked out when they change and stays where it is. The
 * operations, FA_OPERATIONS, are those that generated code is written with, so results are the same to the bit. */

typedef struct { uint16_t operation, to, a, b; } fa_instruction;

typedef struct {
  const fa_instruction *instructions; /* the last one is FA_AT_END */
  const uint16_t *results;            /* their places in the file */
  int64_t count;
  void (*machine)(double *file, const double *x, const double *u, const double *d, const double *fire, double *r);
  void (*lanes)(void *wide, const double *file, const double *d, void *r, const double *bits);
} fa_program;                         /* machine: the same by machine_code.c, or 0; lanes: four at once, or 0 */

typedef struct {                      /* nonzeros of a Jacobian by rows, in the order in which these are worked out */
  const int32_t *first, *row;         /* of each, one more than there are rows; which row it is */
  const int32_t *kind, *at, *value;   /* FA_OF_..., which one, which result of the program */
  int64_t rows;
  void (*machine)(const double *j, const void *S, const void *D, void *out); /* for directions alone, by machine_code.c, or 0 */
} fa_pattern;

enum {
  FA_PARAMETERS, FA_MODES, FA_DERIVATIVE, FA_GUARDS, FA_FULL, FA_OUTPUTS, FA_UPDATE, FA_FOLLOWING, FA_ENTERING,
  FA_LINE_START, FA_DERIVATIVE_VALUES, FA_GUARDS_VALUES, FA_UPDATE_VALUES, FA_OUTPUTS_VALUES, FA_FOLLOWING_VALUES,
  FA_ENTERING_VALUES, FA_PROGRAMS
};

typedef struct {
  int64_t nq, nx, nu, nw, nd, np, ny, nf, ns, nt, nc, nl, nlr, dirs; /* as FA_NQ ... FA_NLR, FA_DIRS of generated code */
  int64_t registers, constants;
  const double *constant;
  const int32_t *stick_coordinate, *table_length, *table_linear;
  const double *const *table_t, *const *table_v;
  const int32_t *line_clock, *line_first, *line_size, *read_line, *read_memory;
  fa_program program[FA_PROGRAMS];
  fa_pattern derivative, guards, update, outputs, following, entering;
  const int32_t *guards_row, *guards_col, *following_row, *following_col;
} fa_code;

static const double fa_bits[] = {1.0, -0.0}; /* what programs for lanes read: one, and the sign alone */

#define FA_CODE ((const fa_code *)s->code)
#define FA_NQ ((int)FA_CODE->nq)
#define FA_NX ((int)FA_CODE->nx)
#define FA_NU ((int)FA_CODE->nu)
#define FA_NW ((int)FA_CODE->nw)
#define FA_ND ((int)FA_CODE->nd)
#define FA_NP ((int)FA_CODE->np)
#define FA_NY ((int)FA_CODE->ny)
#define FA_NF ((int)FA_CODE->nf)
#define FA_NS ((int)FA_CODE->ns)
#define FA_NT ((int)FA_CODE->nt)
#define FA_NC ((int)FA_CODE->nc)
#define FA_NL ((int)FA_CODE->nl)
#define FA_NLR ((int)FA_CODE->nlr)
#define FA_DIRS ((int)FA_CODE->dirs)
#define FA_NE 0
#define FA_NEI 0
#define FA_NEO 0
#define FA_LINES
#define fa_stick_coordinate FA_CODE->stick_coordinate
#define fa_table_length FA_CODE->table_length
#define fa_table_linear FA_CODE->table_linear
#define fa_table_t FA_CODE->table_t
#define fa_table_v FA_CODE->table_v
#define fa_line_clock FA_CODE->line_clock
#define fa_line_first FA_CODE->line_first
#define fa_line_size FA_CODE->line_size
#define fa_read_line FA_CODE->read_line
#define fa_read_memory FA_CODE->read_memory

static void fa_execute(const fa_instruction *c, double *v) {
#define FA_LABEL(operation) &&do_##operation,
  static const void *const label[] = {FA_OPERATIONS(FA_LABEL) &&fa_end, &&fa_skip};
#undef FA_LABEL
  goto *label[c->operation];
  FA_EVERY_OPERATION
fa_skip: /* unless the condition holds, the next c->b operations give zero and are not carried out */
  if (v[c->a] == 0)
    for (int left = c->b; left > 0; left--) v[(++c)->to] = 0;
  c++;
  goto *label[c->operation];
fa_end:;
}

static double *fa_filled(const fa_code *code, double *file) {
  memset(file, 0, sizeof(double) * (size_t)(code->registers - code->constants));
  memcpy(file + (code->registers - code->constants), code->constant, sizeof(double) * (size_t)code->constants);
  return file;
}

/* Places in the file, which begins with t. */
#define FA_X 1
#define FA_U (FA_X + code->nx)
#define FA_D (FA_U + code->nu + code->nw)
#define FA_M (FA_D + code->nd)
#define FA_P (FA_M + code->nf + code->ns + code->nt)
#define FA_FIRE (FA_P + code->np)

static inline void fa_put(double *to, const double *from, int64_t n) {
  for (int64_t i = 0; i < n; i++) to[i] = from[i];
}

static void fa_evaluate_program(const fa_code *code, double *v, int which, double t, const double *x, const double *u,
                                const double *d, const double *fire, double *r) {
  const fa_program *program = &code->program[which];
  v[0] = t;
  if (program->machine) {
    program->machine(v, x, u, d, fire, r);
    return;
  }
  fa_put(v + FA_X, x, code->nx);
  fa_put(v + FA_U, u, code->nu + code->nw);
  fa_put(v + FA_D, d, code->nd);
  if (fire) fa_put(v + FA_FIRE, fire, code->nc + code->nlr);
  fa_execute(program->instructions, v);
  for (int64_t i = 0; i < program->count; i++) r[i] = v[program->results[i]];
}

static void fa_prepare_file(const fa_code *code, double *v, int which, const double *values) {
  fa_put(v + (which == FA_MODES ? FA_M : FA_P), values, which == FA_MODES ? code->nf + code->ns + code->nt : code->np);
  fa_execute(code->program[which].instructions, v);
}

#define fa_prepare_parameters(p, cp) fa_prepare_file(FA_CODE, s->file, FA_PARAMETERS, p)
#define fa_prepare_modes(m, p, cp, cm) fa_prepare_file(FA_CODE, s->file, FA_MODES, m)
#define FA_EVALUATE(which, t, x, u, d, fire, r) fa_evaluate_program(FA_CODE, s->file, which, t, x, u, d, fire, r)
#define fa_derivative(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_DERIVATIVE, t, x, u, d, fire, r)
#define fa_guards(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_GUARDS, t, x, u, d, fire, r)
#define fa_full(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_FULL, t, x, u, d, fire, r)
#define fa_outputs(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_OUTPUTS, t, x, u, d, fire, r)
#define fa_update(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_UPDATE, t, x, u, d, fire, r)
#define fa_following(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_FOLLOWING, t, x, u, d, fire, r)
#define fa_entering(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_ENTERING, t, x, u, d, fire, r)
#define fa_line_start(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_LINE_START, t, x, u, d, fire, r)
#define fa_derivative_values(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_DERIVATIVE_VALUES, t, x, u, d, fire, r)
#define fa_guards_values(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_GUARDS_VALUES, t, x, u, d, fire, r)
#define fa_update_values(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_UPDATE_VALUES, t, x, u, d, fire, r)
#define fa_outputs_values(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_OUTPUTS_VALUES, t, x, u, d, fire, r)
#define fa_following_values(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_FOLLOWING_VALUES, t, x, u, d, fire, r)
#define fa_entering_values(t, x, u, d, m, p, cp, cm, fire, r) FA_EVALUATE(FA_ENTERING_VALUES, t, x, u, d, fire, r)
