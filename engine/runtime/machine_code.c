/* Byte code as instructions of x86-64, written at once: what each operation does is the same to the bit, in about half
 * the time. Where the processor is another one, or memory may not be made executable, byte code stays.
 *
 * A program is a function of the places where its values lie: the file, x, u, d, fire, and where its results go. Every
 * result goes to its place in the file; those computed last are in registers too, and are read from there. Operations
 * that are no single instruction or few are called, as functions that the compiler made of the same C. Included after
 * bytecode.c; fa_called has these functions, fa_called_in_lanes those on vectors, and FA_DO_ are the operations written out. */

#if defined(__x86_64__) && !defined(_WIN32)
#include <sys/mman.h>

enum { FA_RAX, FA_RCX, FA_RDX, FA_RBX, FA_RSP, FA_RBP, FA_RSI, FA_RDI, FA_R8, FA_R9, FA_R12 = 12, FA_R13, FA_R14, FA_R15 };
enum { FA_IN_FILE, FA_IN_X, FA_IN_U, FA_IN_D, FA_IN_FIRE, FA_IN_RESULT, FA_BASES };
enum { FA_PLAIN = 0x66, FA_SCALAR = 0xF2 };                      /* prefixes: of whole registers, of one double */
enum { FA_LOAD = 0x10, FA_STORE = 0x11, FA_COPY = 0x28, FA_UCOMI = 0x2E, FA_ROOT = 0x51, FA_AND = 0x54, FA_ANDN = 0x55,
       FA_OR = 0x56, FA_XOR = 0x57, FA_ADD = 0x58, FA_MUL = 0x59, FA_SUB = 0x5C, FA_MIN = 0x5D, FA_DIV = 0x5E,
       FA_MAX = 0x5F, FA_SHIFT = 0x73, FA_EQUAL_BITS = 0x76, FA_COMPARE = 0xC2 };
enum { FA_TO_THE_RIGHT = 2, FA_TO_THE_LEFT = 6 };                /* how FA_SHIFT moves the bits of each double */
enum { FA_EQUAL = 0, FA_LESS = 1, FA_LESS_OR_EQUAL = 2, FA_NOT_EQUAL = 4 }; /* what FA_COMPARE asks */
enum { FA_SCRATCH = 2, FA_REGISTERS = 16 };                      /* the first registers are for what is not kept */
enum { FA_MOST_BYTES = 96, FA_MOST_TESTS = 64 };                 /* of an instruction; one within the other */

typedef struct {
  const fa_code *code;
  uint8_t *to;
  const uint8_t *end;       /* of the room; nothing is written beyond */
  int base[FA_BASES];       /* registers that point to the values */
  int holds[FA_REGISTERS];  /* the place whose value a register has, or -1 */
  int next;                 /* the register that is used next */
  int full;                 /* whether the room was too small */
} fa_maker;

static void fa_bytes(fa_maker *m, const void *from, size_t n) {
  if ((size_t)(m->end - m->to) < n) m->full = 1;
  if (m->full) return;
  memcpy(m->to, from, n);
  m->to += n;
}

static void fa_byte(fa_maker *m, int value) {
  const uint8_t byte = (uint8_t)value;
  fa_bytes(m, &byte, 1);
}

static void fa_opcode(fa_maker *m, int prefix, int opcode, int reg, int other) {
  const int extended = (reg >= 8 ? 4 : 0) | (other >= 8 ? 1 : 0);
  fa_byte(m, prefix);
  if (extended) fa_byte(m, 0x40 | extended);
  fa_byte(m, 0x0F);
  fa_byte(m, opcode);
}

static void fa_with_register(fa_maker *m, int prefix, int opcode, int reg, int other) {
  fa_opcode(m, prefix, opcode, reg, other);
  fa_byte(m, 0xC0 | (reg & 7) << 3 | (other & 7));
}

static void fa_with_memory(fa_maker *m, int prefix, int opcode, int reg, int base, int64_t index) {
  const int32_t offset = (int32_t)(index * 8);
  const int near = offset >= -128 && offset <= 127;
  fa_opcode(m, prefix, opcode, reg, base);
  fa_byte(m, (near ? 0x40 : 0x80) | (reg & 7) << 3 | (base & 7));
  if ((base & 7) == FA_RSP) fa_byte(m, 0x24);
  fa_bytes(m, &offset, near ? 1 : 4);
}

/* Where a place of the file is to be read: what a caller gives stays with the caller. */
static void fa_find_place(const fa_maker *m, int64_t place, int *kind, int64_t *index) {
  const fa_code *code = m->code;
  const int64_t first[] = {0, FA_X, FA_U, FA_D, FA_FIRE}, end[] = {0, FA_U, FA_D, FA_M, FA_FIRE + code->nc + code->nlr};
  *kind = FA_IN_FILE;
  *index = place;
  for (int k = FA_IN_X; k <= FA_IN_FIRE; k++)
    if (place >= first[k] && place < end[k]) {
      *kind = k;
      *index = place - first[k];
    }
}

/* An operation on a register and a value of the file. */
static void fa_with(fa_maker *m, int prefix, int opcode, int reg, int64_t place) {
  int kind;
  int64_t index;
  for (int k = FA_SCRATCH; k < FA_REGISTERS; k++)
    if (m->holds[k] == place) {
      fa_with_register(m, prefix, opcode, reg, k);
      return;
    }
  fa_find_place(m, place, &kind, &index);
  fa_with_memory(m, prefix, opcode, reg, m->base[kind], index);
}

static void fa_load(fa_maker *m, int reg, int64_t place) {
  for (int k = FA_SCRATCH; k < FA_REGISTERS; k++)
    if (m->holds[k] == place) {
      fa_with_register(m, FA_PLAIN, FA_COPY, reg, k);
      return;
    }
  fa_with(m, FA_SCALAR, FA_LOAD, reg, place);
}

static void fa_forget(fa_maker *m) {
  for (int k = 0; k < FA_REGISTERS; k++) m->holds[k] = -1;
}

static int fa_fresh(fa_maker *m) {
  if (++m->next == FA_REGISTERS) m->next = FA_SCRATCH;
  m->holds[m->next] = -1;
  return m->next;
}

static void fa_compare(fa_maker *m, int question, int reg, int64_t place) {
  fa_with(m, FA_SCALAR, FA_COMPARE, reg, place);
  fa_byte(m, question);
}

static void fa_compare_registers(fa_maker *m, int question, int reg, int other) {
  fa_with_register(m, FA_SCALAR, FA_COMPARE, reg, other);
  fa_byte(m, question);
}

static void fa_zero(fa_maker *m, int reg) { fa_with_register(m, FA_PLAIN, FA_XOR, reg, reg); }

static void fa_all_bits(fa_maker *m, int reg) { fa_with_register(m, FA_PLAIN, FA_EQUAL_BITS, reg, reg); }

static void fa_shift(fa_maker *m, int way, int reg, int bits) {
  fa_with_register(m, FA_PLAIN, FA_SHIFT, way, reg);
  fa_byte(m, bits);
}

static void fa_one(fa_maker *m, int reg) { /* of all bits, those of 1.0 */
  fa_all_bits(m, reg);
  fa_shift(m, FA_TO_THE_LEFT, reg, 54);
  fa_shift(m, FA_TO_THE_RIGHT, reg, 2);
}

static void fa_sign_bit(fa_maker *m, int reg) {
  fa_all_bits(m, reg);
  fa_shift(m, FA_TO_THE_LEFT, reg, 63);
}

/* A register of all bits or none, as 1.0 or 0.0. */
static void fa_as_number(fa_maker *m, int reg, int scratch) {
  fa_one(m, scratch);
  fa_with_register(m, FA_PLAIN, FA_AND, reg, scratch);
}

/* Whether a value is not zero, as all bits of a register or none. */
static void fa_not_zero(fa_maker *m, int reg, int64_t place) {
  fa_zero(m, reg);
  fa_compare(m, FA_NOT_EQUAL, reg, place);
}

static void fa_address(fa_maker *m, int reg, const void *address) { /* mov reg, address */
  fa_byte(m, 0x48), fa_byte(m, 0xB8 | reg);
  fa_bytes(m, &address, sizeof address);
}

/* The result of an operation in a register. */
static int fa_computed(fa_maker *m, const fa_instruction *c) {
  const int reg = fa_fresh(m);
  switch (c->operation) {
#define FA_SIMPLE(name, opcode)           \
  case FA_DO_##name:                      \
    fa_load(m, reg, c->a);                \
    fa_with(m, FA_SCALAR, opcode, reg, c->b); \
    break;
    FA_SIMPLE(ADD, FA_ADD)
    FA_SIMPLE(SUB, FA_SUB)
    FA_SIMPLE(MUL, FA_MUL)
    FA_SIMPLE(DIV, FA_DIV)
    FA_SIMPLE(FMIN, FA_MIN)
    FA_SIMPLE(FMAX, FA_MAX)
#define FA_WITH_ITSELF(name, opcode)      \
  case FA_DO_##name:                      \
    fa_load(m, reg, c->a);                \
    fa_with_register(m, FA_SCALAR, opcode, reg, reg); \
    break;
    FA_WITH_ITSELF(SQ, FA_MUL)
    FA_WITH_ITSELF(TWICE, FA_ADD)
    FA_WITH_ITSELF(SQRT, FA_ROOT)
#define FA_QUESTION(name, question)       \
  case FA_DO_##name:                      \
    fa_load(m, reg, c->a);                \
    fa_compare(m, question, reg, c->b);   \
    fa_as_number(m, reg, 0);              \
    break;
    FA_QUESTION(LT, FA_LESS)
    FA_QUESTION(LE, FA_LESS_OR_EQUAL)
    FA_QUESTION(EQ, FA_EQUAL)
    FA_QUESTION(NE, FA_NOT_EQUAL)
#define FA_LOGICAL(name, opcode)          \
  case FA_DO_##name:                      \
    fa_not_zero(m, reg, c->a);            \
    fa_not_zero(m, 1, c->b);              \
    fa_with_register(m, FA_PLAIN, opcode, reg, 1); \
    fa_as_number(m, reg, 0);              \
    break;
    FA_LOGICAL(AND, FA_AND)
    FA_LOGICAL(OR, FA_OR)
    case FA_DO_ASSIGN:
      fa_load(m, reg, c->a);
      break;
    case FA_DO_INV:
      fa_one(m, reg);
      fa_with(m, FA_SCALAR, FA_DIV, reg, c->a);
      break;
    case FA_DO_NEG:
      fa_sign_bit(m, 0);
      fa_load(m, reg, c->a);
      fa_with_register(m, FA_PLAIN, FA_XOR, reg, 0);
      break;
    case FA_DO_FABS:
      fa_load(m, 1, c->a);
      fa_sign_bit(m, reg);
      fa_with_register(m, FA_PLAIN, FA_ANDN, reg, 1);
      break;
    case FA_DO_NOT:
      fa_zero(m, reg);
      fa_compare(m, FA_EQUAL, reg, c->a);
      fa_as_number(m, reg, 0);
      break;
    case FA_DO_IF_ELSE_ZERO:
      fa_not_zero(m, reg, c->a);
      fa_load(m, 1, c->b);
      fa_with_register(m, FA_PLAIN, FA_AND, reg, 1);
      break;
    case FA_DO_SIGN: /* (0 < a) - (a < 0) */
      fa_zero(m, reg);
      fa_compare(m, FA_LESS, reg, c->a);
      fa_as_number(m, reg, 0);
      fa_load(m, 1, c->a);
      fa_zero(m, 0);
      fa_compare_registers(m, FA_LESS, 1, 0);
      fa_as_number(m, 1, 0);
      fa_with_register(m, FA_SCALAR, FA_SUB, reg, 1);
      break;
    default:
      fa_load(m, 0, c->a);
      fa_load(m, 1, c->b);
      fa_address(m, FA_RAX, fa_called[c->operation]);
      fa_byte(m, 0xFF), fa_byte(m, 0xD0); /* call rax, which may use every register of these */
      fa_forget(m);
      fa_with_register(m, FA_PLAIN, FA_COPY, reg, 0);
  }
  return reg;
}

static void fa_keep(fa_maker *m, int reg, int64_t place) {
  fa_with_memory(m, FA_SCALAR, FA_STORE, reg, m->base[FA_IN_FILE], place);
}

static uint8_t *fa_jump(fa_maker *m, int condition) { /* unless 0; where its distance is to be written */
  if (condition) fa_byte(m, 0x0F), fa_byte(m, condition);
  else fa_byte(m, 0xE9);
  fa_bytes(m, "\0\0\0", 4);
  return m->to - 4;
}

static void fa_land(fa_maker *m, uint8_t *jump) {
  const int32_t distance = (int32_t)(m->to - jump - 4);
  if (!m->full) memcpy(jump, &distance, 4);
}

static int fa_calls(const fa_program *program) {
  static const int written[] = {FA_WRITTEN};
  for (const fa_instruction *c = program->instructions; c->operation != FA_AT_END; c++) {
    int found = c->operation == FA_AT_SKIP;
    for (size_t k = 0; k < sizeof written / sizeof *written; k++) found |= written[k] == c->operation;
    if (!found) return 1;
  }
  return 0;
}

/* Registers that a called function leaves alone. */
static const uint8_t fa_saved[] = {FA_RBX, FA_RBP, FA_R12, FA_R13, FA_R14, FA_R15};
static const int fa_given[FA_BASES] = {FA_RDI, FA_RSI, FA_RDX, FA_RCX, FA_R8, FA_R9};
static const int fa_lasting[FA_BASES] = {FA_RBX, FA_RBP, FA_R13, FA_R14, FA_R15, FA_R12};

static void fa_enter(fa_maker *m) {
  for (size_t k = 0; k < sizeof fa_saved; k++) {
    if (fa_saved[k] >= 8) fa_byte(m, 0x41);
    fa_byte(m, 0x50 | (fa_saved[k] & 7)); /* push */
  }
  fa_byte(m, 0x48), fa_byte(m, 0x83), fa_byte(m, 0xEC), fa_byte(m, 8); /* the stack stays aligned */
  for (int k = 0; k < FA_BASES; k++) {
    fa_byte(m, 0x48 | (fa_given[k] >= 8 ? 4 : 0) | (fa_lasting[k] >= 8 ? 1 : 0)); /* mov lasting, given */
    fa_byte(m, 0x89), fa_byte(m, 0xC0 | (fa_given[k] & 7) << 3 | (fa_lasting[k] & 7));
  }
}

static void fa_leave(fa_maker *m) {
  fa_byte(m, 0x48), fa_byte(m, 0x83), fa_byte(m, 0xC4), fa_byte(m, 8);
  for (int k = (int)sizeof fa_saved - 1; k >= 0; k--) {
    if (fa_saved[k] >= 8) fa_byte(m, 0x41);
    fa_byte(m, 0x58 | (fa_saved[k] & 7)); /* pop */
  }
}

/* One program; 0 where too many tests lie within one another. */
static int fa_write(fa_maker *m, const fa_program *program) {
  const int calls = fa_calls(program);
  const fa_instruction *end[FA_MOST_TESTS];
  uint8_t *past[FA_MOST_TESTS];
  int open = 0;
  memcpy(m->base, calls ? fa_lasting : fa_given, sizeof m->base);
  fa_forget(m);
  if (calls) fa_enter(m);
  for (const fa_instruction *c = program->instructions;; c++) {
    while (open && c == end[open - 1]) {
      fa_land(m, past[--open]);
      fa_forget(m);
    }
    if (c->operation == FA_AT_END) break;
    if (c->operation == FA_AT_SKIP) { /* the next c->b operations give zero unless the condition holds */
      if (open == FA_MOST_TESTS) return 0;
      fa_zero(m, 0);
      fa_with(m, FA_PLAIN, FA_UCOMI, 0, c->a);
      uint8_t *unlike = fa_jump(m, 0x85), *unordered = fa_jump(m, 0x8A); /* jne, jp */
      for (int k = 1; k <= c->b; k++) fa_keep(m, 0, c[k].to);
      past[open] = fa_jump(m, 0);
      end[open++] = c + c->b + 1;
      fa_land(m, unlike);
      fa_land(m, unordered);
      continue;
    }
    const int reg = fa_computed(m, c);
    fa_keep(m, reg, c->to);
    m->holds[reg] = c->to;
  }
  for (int64_t k = 0; k < program->count; k++) {
    fa_load(m, 0, program->results[k]);
    fa_with_memory(m, FA_SCALAR, FA_STORE, 0, m->base[FA_IN_RESULT], k);
  }
  if (calls) fa_leave(m);
  fa_byte(m, 0xC3); /* ret */
  return 1;
}

static int64_t fa_most_bytes(const fa_program *program) {
  int64_t bytes = (program->count + 2) * FA_MOST_BYTES;
  for (const fa_instruction *c = program->instructions; c->operation != FA_AT_END; c++)
    bytes += FA_MOST_BYTES + (c->operation == FA_AT_SKIP ? c->b * 10 : 0);
  return bytes;
}

#if FA_WIDTH == 4 && defined(__AVX__)
#define FA_FOUR
enum { FA_BROADCAST = 0x19, FA_OF_FOUR = 1 << 2 | 1, FA_OF_ONE = 3 }; /* vector length and prefix */

/* An instruction on three registers, or on two and memory, whose base is neither RSP nor R12. */
static void fa_three(fa_maker *m, int map, int kind, int opcode, int reg, int first, int last, int64_t offset) {
  const int32_t there = (int32_t)offset;
  fa_byte(m, 0xC4);
  fa_byte(m, (reg >= 8 ? 0 : 0x80) | 0x40 | (last >= 8 ? 0 : 0x20) | map);
  fa_byte(m, (~first & 15) << 3 | kind);
  fa_byte(m, opcode);
  fa_byte(m, (offset < 0 ? 0xC0 : 0x80) | (reg & 7) << 3 | (last & 7));
  if (offset >= 0) fa_bytes(m, &there, 4);
}

static void fa_single(fa_maker *m) { /* vzeroupper */
  fa_byte(m, 0xC5), fa_byte(m, 0xF8), fa_byte(m, 0x77);
}

#ifdef FA_MOST_DIRS
#define FA_BLOCKS_OF_TANGENTS
enum { FA_BLOCK = 32, FA_BLOCKS = FA_OWN_LANES * (int)sizeof(fa_lane) / FA_BLOCK }; /* of a row of tangents: registers */

static int64_t fa_bytes_of_pattern(const fa_pattern *p) {
  const int64_t entries = p->rows ? p->first[p->rows] : 0;
  return entries * (FA_BLOCKS * 18 + 36) + p->rows * FA_BLOCKS * 18 + 16;
}

/* What fa_apply does without dt and the step's length: each row is kept in registers while what it depends on is added. */
static void fa_write_pattern(fa_maker *m, const fa_pattern *p) {
  enum { J = FA_RDI, S = FA_RSI, D = FA_RDX, OUT = FA_RCX, ROW = 2 };
  static const int of[] = {S, D, OUT}; /* by kind */
  for (int64_t i = 0; i < p->rows; i++) {
    int64_t k = p->first[i];
    const int64_t begin = k, last = p->first[i + 1];
    const int64_t out = p->row[i] * (int64_t)sizeof(fa_columns);
    for (; k < last && p->kind[k] <= FA_OF_SHARED; k++) {
      fa_three(m, 2, FA_OF_FOUR, FA_BROADCAST, 0, 0, J, p->value[k] * 8);
      for (int l = 0; l < FA_BLOCKS; l++) {
        const int64_t from = p->at[k] * (int64_t)sizeof(fa_columns) + l * FA_BLOCK;
        fa_three(m, 1, FA_OF_FOUR, FA_MUL, k == begin ? ROW + l : 1, 0, of[p->kind[k]], from);
        if (k > begin) fa_three(m, 1, FA_OF_FOUR, FA_ADD, ROW + l, ROW + l, 1, -1);
      }
    }
    for (int l = 0; l < FA_BLOCKS; l++) {
      if (k == begin) fa_three(m, 1, FA_OF_FOUR, FA_XOR, ROW + l, ROW + l, ROW + l, -1);
      fa_three(m, 1, FA_OF_FOUR, FA_STORE, ROW + l, 0, OUT, out + l * FA_BLOCK);
    }
    while (k < last && p->kind[k] <= FA_OF_INPUT) k++;
    for (; k < last; k++) {
      fa_three(m, 1, FA_OF_ONE, FA_LOAD, 1, 0, OUT, out + p->at[k] * 8);
      fa_three(m, 1, FA_OF_ONE, FA_ADD, 1, 1, J, p->value[k] * 8);
      fa_three(m, 1, FA_OF_ONE, FA_STORE, 1, 0, OUT, out + p->at[k] * 8);
    }
  }
  fa_single(m);
  fa_byte(m, 0xC3);
}
#endif

/* -- a program for four at once ---------------------------------------------------------------------------------- */

/* What differs between the four lies in a file of vectors, `wide`: for the stages of one run's step t, x, u and what a program
 * works out of them; for four runs everything. All else is the same for them, and is read from where one run has it.
 * Operations are those of one run, lane by lane. */
#ifdef FA_MOST_DIRS
static const int fa_in_lanes[] = {FA_DERIVATIVE_VALUES};
#else
static const int fa_in_lanes[] = {FA_DERIVATIVE, FA_GUARDS, FA_FULL, FA_OUTPUTS, FA_UPDATE};
#endif
enum { FA_IN_WIDE, FA_IN_ONE, FA_IN_MEMORIES, FA_IN_WIDE_RESULT, FA_IN_BITS };
enum { FA_PLUS_ONE = 0, FA_SIGN_BIT = 1 };                       /* in FA_IN_BITS */
enum { FA_MOST_LANE_BYTES = 128, FA_MOST_WIDE = 4096 };          /* of an instruction; places of a model */

typedef struct {
  fa_maker *m;
  const uint8_t *wide;      /* whether a place lies in the file of vectors */
} fa_wide;

static void fa_four(const fa_wide *w, int opcode, int reg, int first, int last) {
  fa_three(w->m, 1, FA_OF_FOUR, opcode, reg, first, last, -1);
}

static void fa_bits_in(const fa_wide *w, int reg, int which) {
  fa_three(w->m, 2, FA_OF_FOUR, FA_BROADCAST, reg, 0, w->m->base[FA_IN_BITS], which * 8);
}

/* Where one value lies that is the same for all, or the first of four. */
static void fa_find_wide(const fa_wide *w, int64_t place, int *base, int64_t *offset) {
  const fa_code *code = w->m->code;
  const int memory = place >= FA_D && place < FA_M;
  *base = w->m->base[w->wide[place] ? FA_IN_WIDE : memory ? FA_IN_MEMORIES : FA_IN_ONE];
  *offset = w->wide[place] ? place * (int64_t)sizeof(fa_lane) : (memory ? place - FA_D : place) * 8;
}

/* The register that has a value: one that holds it, or a given one. */
static int fa_four_of(const fa_wide *w, int64_t place, int given) {
  int base;
  int64_t offset;
  for (int k = FA_SCRATCH; k < FA_REGISTERS; k++)
    if (w->m->holds[k] == place) return k;
  fa_find_wide(w, place, &base, &offset);
  if (w->wide[place]) fa_three(w->m, 1, FA_OF_FOUR, FA_LOAD, given, 0, base, offset);
  else fa_three(w->m, 2, FA_OF_FOUR, FA_BROADCAST, given, 0, base, offset);
  return given;
}

static void fa_four_compare(const fa_wide *w, int question, int reg, int first, int last) {
  fa_four(w, FA_COMPARE, reg, first, last);
  fa_byte(w->m, question);
}

/* Where all bits are set, 1.0; else 0.0. */
static void fa_four_as_number(const fa_wide *w, int reg) {
  fa_bits_in(w, 0, FA_PLUS_ONE);
  fa_four(w, FA_AND, reg, reg, 0);
}

/* Whether values are not zero, as all bits or none. */
static void fa_four_not_zero(const fa_wide *w, int reg, int64_t place) {
  const int value = fa_four_of(w, place, 0);
  fa_four(w, FA_XOR, reg, reg, reg);
  fa_four_compare(w, FA_NOT_EQUAL, reg, reg, value);
}

static void fa_four_into(const fa_wide *w, int reg, int64_t place) {
  const int from = fa_four_of(w, place, reg);
  if (from != reg) fa_four(w, FA_OR, reg, from, from);
}

static int fa_four_computed(const fa_wide *w, const fa_instruction *c) {
  const int reg = fa_fresh(w->m);
  int first, last;
  switch (c->operation) {
#define FA_FOUR_SIMPLE(name, opcode)              \
  case FA_DO_##name:                              \
    first = fa_four_of(w, c->a, 0);               \
    last = fa_four_of(w, c->b, 1);                \
    fa_four(w, opcode, reg, first, last);         \
    break;
    FA_FOUR_SIMPLE(ADD, FA_ADD)
    FA_FOUR_SIMPLE(SUB, FA_SUB)
    FA_FOUR_SIMPLE(MUL, FA_MUL)
    FA_FOUR_SIMPLE(DIV, FA_DIV)
    FA_FOUR_SIMPLE(FMIN, FA_MIN)
    FA_FOUR_SIMPLE(FMAX, FA_MAX)
#define FA_FOUR_WITH_ITSELF(name, opcode)         \
  case FA_DO_##name:                              \
    first = fa_four_of(w, c->a, 0);               \
    fa_four(w, opcode, reg, first, first);        \
    break;
    FA_FOUR_WITH_ITSELF(SQ, FA_MUL)
    FA_FOUR_WITH_ITSELF(TWICE, FA_ADD)
#define FA_FOUR_QUESTION(name, question)          \
  case FA_DO_##name:                              \
    first = fa_four_of(w, c->a, 0);               \
    last = fa_four_of(w, c->b, 1);                \
    fa_four_compare(w, question, reg, first, last); \
    fa_four_as_number(w, reg);                    \
    break;
    FA_FOUR_QUESTION(LT, FA_LESS)
    FA_FOUR_QUESTION(LE, FA_LESS_OR_EQUAL)
    FA_FOUR_QUESTION(EQ, FA_EQUAL)
    FA_FOUR_QUESTION(NE, FA_NOT_EQUAL)
#define FA_FOUR_LOGICAL(name, opcode)             \
  case FA_DO_##name:                              \
    fa_four_not_zero(w, reg, c->a);               \
    fa_four_not_zero(w, 1, c->b);                 \
    fa_four(w, opcode, reg, reg, 1);              \
    fa_four_as_number(w, reg);                    \
    break;
    FA_FOUR_LOGICAL(AND, FA_AND)
    FA_FOUR_LOGICAL(OR, FA_OR)
    case FA_DO_SQRT: /* of one register */
      fa_four(w, FA_ROOT, reg, 0, fa_four_of(w, c->a, 0));
      break;
    case FA_DO_ASSIGN:
      fa_four_into(w, reg, c->a);
      break;
    case FA_DO_INV:
      last = fa_four_of(w, c->a, 0);
      fa_bits_in(w, 1, FA_PLUS_ONE);
      fa_four(w, FA_DIV, reg, 1, last);
      break;
    case FA_DO_NEG:
      first = fa_four_of(w, c->a, 0);
      fa_bits_in(w, 1, FA_SIGN_BIT);
      fa_four(w, FA_XOR, reg, first, 1);
      break;
    case FA_DO_FABS:
      last = fa_four_of(w, c->a, 0);
      fa_bits_in(w, 1, FA_SIGN_BIT);
      fa_four(w, FA_ANDN, reg, 1, last);
      break;
    case FA_DO_NOT:
      last = fa_four_of(w, c->a, 0);
      fa_four(w, FA_XOR, reg, reg, reg);
      fa_four_compare(w, FA_EQUAL, reg, reg, last);
      fa_four_as_number(w, reg);
      break;
    case FA_DO_IF_ELSE_ZERO:
      fa_four_not_zero(w, reg, c->a);
      fa_four(w, FA_AND, reg, reg, fa_four_of(w, c->b, 1));
      break;
    case FA_DO_SIGN: /* (0 < a) - (a < 0) */
      last = fa_four_of(w, c->a, 1);
      fa_four(w, FA_XOR, 0, 0, 0);
      fa_four_compare(w, FA_LESS, reg, 0, last);
      fa_four_compare(w, FA_LESS, 1, last, 0);
      fa_four_as_number(w, reg);
      fa_four(w, FA_AND, 1, 1, 0);
      fa_four(w, FA_SUB, reg, reg, 1);
      break;
    default:
      fa_four_into(w, 0, c->a);
      fa_four_into(w, 1, c->b);
      fa_address(w->m, FA_RAX, fa_called_in_lanes[c->operation]);
      fa_byte(w->m, 0xFF), fa_byte(w->m, 0xD0);
      fa_forget(w->m);
      fa_four(w, FA_OR, reg, 0, 0);
  }
  return reg;
}

static void fa_keep_wide(const fa_wide *w, int reg, int64_t place) {
  fa_three(w->m, 1, FA_OF_FOUR, FA_STORE, reg, 0, w->m->base[FA_IN_WIDE], place * (int64_t)sizeof(fa_lane));
}

/* One program for four lanes; 0 where it is too large. What is passed over where a condition fails, and is asked for where it
 * holds alone, is passed over where it fails in all four. */
static int fa_write_wide(fa_maker *m, const fa_program *program) {
  uint8_t wide[FA_MOST_WIDE];
  const fa_code *code = m->code;
  const int calls = fa_calls(program);
  const fa_instruction *end[FA_MOST_TESTS];
  uint8_t *past[FA_MOST_TESTS];
  const fa_wide w = {m, wide};
  int open = 0;
  if (code->registers > FA_MOST_WIDE) return 0;
#ifdef FA_MOST_DIRS
  memset(wide, 0, sizeof wide);
  memset(wide, 1, (size_t)FA_D); /* t, x, u */
  for (const fa_instruction *c = program->instructions; c->operation != FA_AT_END; c++)
    if (c->operation != FA_AT_SKIP) wide[c->to] = 1;
#else
  memset(wide, 1, sizeof wide);
#endif
  memcpy(m->base, calls ? fa_lasting : fa_given, sizeof m->base);
  fa_forget(m);
  if (calls) fa_enter(m);
  for (const fa_instruction *c = program->instructions;; c++) {
    while (open && c == end[open - 1]) {
      fa_land(m, past[--open]);
      fa_forget(m);
    }
    if (c->operation == FA_AT_END) break;
    if (c->operation == FA_AT_SKIP) {
      if (open == FA_MOST_TESTS) return 0;
      fa_four_not_zero(&w, 1, c->a);
      fa_four(&w, 0x50, FA_RAX, 0, 1);           /* movmskpd eax, ymm1 */
      fa_byte(m, 0x85), fa_byte(m, 0xC0);        /* test eax, eax */
      uint8_t *some = fa_jump(m, 0x85);          /* jne */
      fa_four(&w, FA_XOR, 0, 0, 0);
      for (int k = 1; k <= c->b; k++)
        if (c[k].operation != FA_AT_SKIP) fa_keep_wide(&w, 0, c[k].to);
      past[open] = fa_jump(m, 0);
      end[open++] = c + c->b + 1;
      fa_land(m, some);
      continue;
    }
    const int reg = fa_four_computed(&w, c);
    fa_keep_wide(&w, reg, c->to);
    m->holds[reg] = c->to;
  }
  for (int64_t k = 0; k < program->count; k++)
    fa_three(m, 1, FA_OF_FOUR, FA_STORE, fa_four_of(&w, program->results[k], 0), 0, m->base[FA_IN_WIDE_RESULT],
             k * (int64_t)sizeof(fa_lane));
  fa_single(m);
  if (calls) fa_leave(m);
  fa_byte(m, 0xC3);
  return 1;
}

static int64_t fa_most_wide_bytes(const fa_program *program) {
  int64_t bytes = (program->count + 2) * FA_MOST_LANE_BYTES;
  for (const fa_instruction *c = program->instructions; c->operation != FA_AT_END; c++)
    bytes += FA_MOST_LANE_BYTES + (c->operation == FA_AT_SKIP ? c->b * 18 : 0);
  return bytes;
}
#endif

/* Gives the programs of a model that are run at every step machine code; returns where it lies and how much. */
FA_EXPORT void *fa_translate(fa_code *code, int64_t *size) {
  *size = 0;
  for (int k = FA_DERIVATIVE; k < FA_PROGRAMS; k++) *size += fa_most_bytes(&code->program[k]);
#ifdef FA_BLOCKS_OF_TANGENTS
  fa_pattern *const patterns[] = {&code->derivative, &code->guards, &code->update, &code->outputs, &code->entering};
  const int tangents = sizeof patterns / sizeof *patterns;
  for (int k = 0; k < tangents; k++) *size += fa_bytes_of_pattern(patterns[k]);
#endif
#ifdef FA_FOUR
  enum { FA_FOURS = sizeof fa_in_lanes / sizeof *fa_in_lanes };
  for (int k = 0; k < FA_FOURS; k++) *size += fa_most_wide_bytes(&code->program[fa_in_lanes[k]]);
#endif
  uint8_t *const room = mmap(0, (size_t)*size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (room == MAP_FAILED) return 0;
  fa_maker m = {.code = code, .to = room, .end = room + *size, .next = FA_SCRATCH};
  uint8_t *entry[FA_PROGRAMS] = {0};
  for (int k = FA_DERIVATIVE; k < FA_PROGRAMS; k++) {
    uint8_t *const begin = m.to;
    if (fa_write(&m, &code->program[k])) entry[k] = begin;
    else m.to = begin;
  }
#ifdef FA_BLOCKS_OF_TANGENTS
  uint8_t *applied[sizeof patterns / sizeof *patterns];
  for (int k = 0; k < tangents; k++) {
    applied[k] = m.to;
    fa_write_pattern(&m, patterns[k]);
  }
#endif
#ifdef FA_FOUR
  uint8_t *four[FA_FOURS] = {0};
  for (int k = 0; k < FA_FOURS; k++) {
    uint8_t *const begin = m.to;
    if (fa_write_wide(&m, &code->program[fa_in_lanes[k]])) four[k] = begin;
    else m.to = begin;
  }
#endif
  if (m.full || mprotect(room, (size_t)*size, PROT_READ | PROT_EXEC)) {
    munmap(room, (size_t)*size);
    return 0;
  }
  for (int k = FA_DERIVATIVE; k < FA_PROGRAMS; k++) memcpy(&code->program[k].machine, &entry[k], sizeof entry[k]);
#ifdef FA_BLOCKS_OF_TANGENTS
  for (int k = 0; k < tangents; k++) memcpy(&patterns[k]->machine, &applied[k], sizeof applied[k]);
#endif
#ifdef FA_FOUR
  for (int k = 0; k < FA_FOURS; k++) memcpy(&code->program[fa_in_lanes[k]].lanes, &four[k], sizeof four[k]);
#endif
  return room;
}

FA_EXPORT void fa_release(void *room, int64_t size) { munmap(room, (size_t)size); }

#else
FA_EXPORT void *fa_translate(fa_code *code, int64_t *size) {
  (void)code;
  *size = 0;
  return 0;
}

FA_EXPORT void fa_release(void *room, int64_t size) { (void)room, (void)size; }
#endif
