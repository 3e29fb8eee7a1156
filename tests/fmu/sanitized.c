/* Drives every function of an FMU whose sources are compiled in, with sanitizers watching: FMI=2 or FMI=3.
 *
 *   host GUID STATES INDICATORS REFERENCES INPUT OUTPUT ACTIONS
 *
 * First calls with known answers, then random ones in random order, right and wrong. Every array is a heap block of exactly
 * its length, so reading or writing past its end is seen. A call that is refused must give "discard" or "error" and log. */

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { OK = 0, DISCARD = 2, ERROR = 3 };
enum { SLAVE, EXCHANGE, EVENTS, EARLY };              /* Co-Simulation; with event mode; with early return too */
enum { GIVE_X, TAKE_X, TAKE_RATES, TAKE_GUARDS, TAKE_NOMINALS };

static long messages;
static size_t states, indicators, references;
static unsigned input, output;
static const char *guid;

#define must(holds) ((holds) ? (void)0 : broken(__FILE__, __LINE__, #holds))

static void broken(const char *file, int line, const char *what) {
  fprintf(stderr, "%s:%d: %s\n", file, line, what);
  exit(9);
}

static void said(const char *text) {
  must(text && *text && strlen(text) < 700 && !strpbrk(text, "%#\n"));
  messages++;
}

/* -- blocks of exactly one size, given back all at once -------------------------------------------------------------- */

static void *blocks[4096];
static int used;

static void *room(size_t size) {
  must(used < 4096);
  return blocks[used++] = malloc(size ? size : 1);
}

static void *copy(const void *bytes, size_t size) { return memcpy(room(size), bytes, size); }
static void tidy(void) { while (used) free(blocks[--used]); }

/* -- chance ---------------------------------------------------------------------------------------------------------- */

static uint64_t seed = 88172645463325252u;

static unsigned chance(unsigned n) {
  seed ^= seed << 13, seed ^= seed >> 7, seed ^= seed << 17;
  return (unsigned)(seed >> 33) % n;
}

static double odd(void) {
  static const double values[] = {0, 1, -1, 0.37, 3, -2, 1e-3, 5e-324, 1e160, -1e308, NAN, INFINITY, -INFINITY};
  return values[chance(sizeof values / sizeof *values)];
}

static unsigned some_reference(void) {
  return chance(8) ? chance((unsigned)references) : (unsigned)references + (chance(2) ? chance(3) : 0u - 1u - (unsigned)references);
}

static unsigned *some_references(size_t n) {
  unsigned *vr = room(n * sizeof *vr);
  for (size_t i = 0; i < n; i++) vr[i] = some_reference();
  return vr;
}

static double *some_values(size_t n) {
  double *values = room(n * sizeof *values);
  for (size_t i = 0; i < n; i++) values[i] = odd();
  return values;
}

static int muted;                                     /* logging was called off */

#if FMI == 2
#include "sanitized_fmi2.h"
#else
#include "sanitized_fmi3.h"
#endif

/* A status of the standard, and a message with it unless it is logging that was called off. */
static long before;

static int checked(int status) {
  must(status == OK || status == DISCARD || status == ERROR);
  must(status == OK || messages > before || muted);
  return status;
}

#define call(...) (before = messages, checked(__VA_ARGS__))
#define fine(...) must(call(__VA_ARGS__) == OK)
#define fails(...) must(call(__VA_ARGS__) == ERROR)

static double now(instance c) {
  const unsigned vr = 0;
  double time = NAN;
  get(c, &vr, 1, &time);
  return time;
}

static void begin(instance c, double start) {
  fine(enter(c, start, 0, 0));
  fine(leave(c));
}

static void run(instance c, int first, int count, double *end) {
  for (int k = first; k < first + count; k++) {
    const double volt = 3 * sin(0.7 * k);
    if (input) fine(set(c, &input, 1, &volt));
    fine(step(c, k * 1e-3, 1e-3));
  }
  fine(get(c, &output, 1, end));
}

/* -- calls with known answers ---------------------------------------------------------------------------------------- */

static void no_instances(void) {
  must(!make(0, guid, 0, 1) && !make("", guid, 0, 1) && !make("x", 0, 0, 1) && !make("x", "{other}", 0, 1));
  must(messages == 4);
  no_more_instances();
  char name[2000];
  memset(name, 's', sizeof name), name[sizeof name - 1] = 0;
  instance long_name = make(name, guid, 0, 1), odd_name = make("%s%n #i#", guid, 0, 1);
  fails(step(odd_name, 0, 1e-3));
  release(long_name), release(odd_name);
  release(0);
  double value = 7;
  const unsigned vr = 0;
  void *state = 0;
  size_t size;
  must(enter(0, 0, 0, 0) == ERROR && leave(0) == ERROR && end(0) == ERROR && reset(0) == ERROR);
  must(get(0, &vr, 1, &value) == ERROR && set(0, &vr, 1, &value) == ERROR && step(0, 0, 1e-3) == ERROR && value == 7);
  must(save(0, &state) == ERROR && restore(0, 0) == ERROR && forget(0, &state) == ERROR && !state);
  must(measure(0, 0, &size) == ERROR && serialise(0, 0, 0, 0) == ERROR && deserialise(0, 0, 0, &state) == ERROR);
  must(discrete(0) == ERROR && event_mode(0) == ERROR && continuous(0) == ERROR && completed(0) == ERROR);
  must(set_time(0, 0) == ERROR && array(0, TAKE_X, &value, 1) == ERROR);
  must(directional(0, &vr, 1, &vr, 1, &value, &value) == ERROR);
}

static void bad_arguments(void) {
  instance c = make("bad", guid, 0, 1);
  void *state = 0;
  size_t size = 0;
  double value = 7, y;
  const unsigned unknown[] = {(unsigned)references, (unsigned)references + 1, 1u << 31, ~0u};
  fails(enter(c, NAN, 0, 0)), fails(enter(c, 1e300, 0, 0)), fails(enter(c, 0, 1, -1));
  begin(c, 0);
  run(c, 0, 20, &y);
  for (int i = 0; i < 4; i++) {
    fails(get(c, &unknown[i], 1, &value)), fails(set(c, &unknown[i], 1, &value)), fails(whole(c, &unknown[i], 1, room(4)));
    fails(directional(c, &unknown[i], 1, &input, 1, &value, &value));
    fails(directional(c, &output, 1, &unknown[i], 1, &value, &value));
  }
  fails(get(c, 0, 1, &value)), fails(get(c, &output, 1, 0)), fails(set(c, 0, 1, &value)), fails(set(c, &input, 1, 0));
  fails(whole(c, 0, 1, room(4))), fails(whole(c, &output, 1, 0)), fails(set(c, &output, 1, &value));
  fails(directional(c, 0, 1, &input, 1, &value, &value));
  must(value == 7);
  const double wrong[] = {NAN, INFINITY, -INFINITY};
  for (int i = 0; i < 3; i++) {
    if (input) must(call(set(c, &input, 1, &wrong[i])) == DISCARD);
    fails(step(c, wrong[i], 1e-3)), fails(step(c, 0.02, wrong[i]));
  }
  fails(step(c, 0.02, 0)), fails(step(c, 0.02, -1e-3)), fails(step(c, 0.5, 1e-3)), fails(step(c, 0.02, 1e300));
  fails(save(c, 0)), fails(restore(c, 0)), fails(measure(c, 0, &size)), fails(serialise(c, 0, 0, 0));
  fails(deserialise(c, 0, 8, &state));
  must(!state);
  fails(enter(c, 0, 0, 0)), fails(leave(c)), fails(event_mode(c)), fails(discrete(c)), fails(continuous(c));
  fails(completed(c)), fails(set_time(c, 0)), fails(array(c, GIVE_X, room(states * 8), states));
  fine(get(c, &output, 1, &value));
  must(value == y);
  release(c);
  tidy();
}

static void states_and_bytes(void) {
  instance c = make("saved", guid, 0, 1), other = make("other", guid, 0, 1), exchanging = make("ode", guid, 1, 1);
  void *state = 0, *again = 0;
  size_t size = 0;
  double first, second;
  begin(c, 0);
  run(c, 0, 30, &first);
  fine(save(c, &state));
  run(c, 30, 40, &first);
  fine(restore(c, state));
  run(c, 30, 40, &second);
  must(!memcmp(&first, &second, sizeof first));
  fine(measure(c, state, &size));
  unsigned char *bytes = room(size);
  fails(serialise(c, state, bytes, size - 1)), fails(serialise(c, state, 0, size));
  fine(serialise(c, state, bytes, size));
  fine(save(other, &again));                                    /* made once, then written over */
  fine(deserialise(other, bytes, size, &again));
  fine(restore(other, again));
  run(other, 30, 40, &second);
  must(!memcmp(&first, &second, sizeof first));
  fails(restore(exchanging, again));                            /* an instance of the other kind */
  for (size_t n = 0; n <= size + 1; n++) {
    if (n == size) continue;
    unsigned char *cut = malloc(n ? n : 1);
    memset(cut, 0, n ? n : 1), memcpy(cut, bytes, n < size ? n : size);
    fails(deserialise(other, cut, n, &again));
    free(cut);
  }
  for (size_t n = 0; n < size; n++) {
    bytes[n] ^= (unsigned char)(1u << n % 8);
    fails(deserialise(other, bytes, size, &again));
    bytes[n] ^= (unsigned char)(1u << n % 8);
  }
  fine(forget(c, &state)), fine(forget(other, &again)), fine(forget(c, &state));
  must(!state && !again);
  release(c), release(other), release(exchanging);
  tidy();
}

/* -- calls by chance ------------------------------------------------------------------------------------------------- */

#define SLOTS 4

typedef struct { instance c; void *state[SLOTS]; } patient;

static unsigned char *bytes_of;                                 /* of a state that was written out */
static size_t size_of;

static void forget_all(patient *p) {
  for (int i = 0; i < SLOTS; i++) if (p->state[i]) fine(forget(p->c, &p->state[i]));
}

static void act(patient *p) {
  instance c = p->c;
  const size_t n = chance(4);
  void **slot = &p->state[chance(SLOTS)];
  const double time = now(c), near = time + 1e-3 * chance(5);
  unsigned *vr = some_references(n);
  double *values = some_values(n);
  switch (chance(26)) {
    case 0: call(enter(c, chance(3) ? 0 : odd(), !chance(3), odd())); break;
    case 1: case 2: call(leave(c)); break;
    case 3: if (!chance(10)) call(end(c)); break;
    case 4: if (!chance(10)) call(reset(c)); break;
    case 5: case 6: case 7: call(step(c, chance(9) ? time : odd(), chance(9) ? 1e-3 * (1 + chance(3)) : fmin(odd(), 1))); break;
    case 8: for (size_t i = 0; i < n; i++) if (chance(4)) vr[i] = input, values[i] = chance(7) - 3.0;  /* fall through */
    case 9: call(set(c, vr, n, values)); break;
    case 10: call(get(c, vr, n, values)); break;
    case 11: call(whole(c, vr, n, room(n * sizeof(int32_t)))); break;
    case 12: call(save(c, slot)); break;
    case 13: call(restore(c, *slot)); break;
    case 14: call(forget(c, slot)); break;
    case 15: {
      size_t size = 0;
      if (call(measure(c, *slot, &size)) || !size) break;
      free(bytes_of);
      bytes_of = malloc(size), size_of = size;
      fine(serialise(c, *slot, bytes_of, size));
      break;
    }
    case 16: {
      if (!bytes_of) break;
      const size_t length = chance(2) ? size_of : chance((unsigned)size_of);
      unsigned char *part = copy(bytes_of, length);
      const int spoilt = length && chance(2);
      if (spoilt) part[chance((unsigned)length)] ^= (unsigned char)(1 + chance(255));
      must((call(deserialise(c, part, length, slot)) == OK) == (length == size_of && !spoilt));
      break;
    }
    case 17: {
      const size_t m = chance(4);
      call(directional(c, vr, n, some_references(m), m, some_values(m), values));
      break;
    }
    case 18: call(event_mode(c)); break;
    case 19: case 20: call(discrete(c)); break;
    case 21: call(chance(2) ? continuous(c) : step_mode(c)); break;
    case 22: call(chance(2) ? completed(c) : set_time(c, chance(9) ? near : odd() * 1e-3)); break;
    case 23: {
      const int what = (int)chance(5);
      const size_t right = what == TAKE_GUARDS ? indicators : states, length = chance(5) ? right : right + 1;
      call(array(c, what, some_values(length), length));
      break;
    }
    case 24: everything_else(c, vr, n, values); break;
    default:
      if (chance(50)) break;
      forget_all(p);
      release(c);
      p->c = make("again", guid, (int)chance(4), 1);
      must(p->c);
  }
  tidy();
}

int main(int count, char **word) {
  must(count == 8);
  guid = word[1];
  states = strtoul(word[2], 0, 10), indicators = strtoul(word[3], 0, 10), references = strtoul(word[4], 0, 10);
  input = (unsigned)strtoul(word[5], 0, 10), output = (unsigned)strtoul(word[6], 0, 10);
  no_instances();
  bad_arguments();
  states_and_bytes();
  patient all[3] = {{make("a", guid, SLAVE, 1), {0}}, {make("b", guid, EXCHANGE, 1), {0}}, {make("c", guid, EARLY, 1), {0}}};
  for (long k = strtol(word[7], 0, 10); k > 0; k--) act(&all[chance(3)]);
  for (int i = 0; i < 3; i++) forget_all(&all[i]), release(all[i].c);
  free(bytes_of);
  printf("%ld\n", messages);
  return 0;
}
