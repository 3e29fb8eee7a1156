/* The library of an FMU whose model runs in Python: FMI 2.0 Co-Simulation, every call passed on to a Python process.
 *
 * Each instance has a process of its own, started here; no Python is loaded into the importer. The library is the same
 * for every model: what differs is in resources/python.txt, a line each: the GUID, the version of flexarm, the oldest
 * Python, and the Python that exported. The process runs resources/start.py, which says hello:
 *
 *   "flexarm\0", then an answer: OK, or why this Python will not do, and then the next one is tried.
 *
 *   request: uint32 what is asked (FP_SETUP and so on), uint32 length, arguments
 *   answer:  uint32 status of FMI, uint32 length of messages, uint32 length of results, messages, results
 *   message: uint32 status of FMI, uint32 length, text
 *
 * Numbers have this machine's byte order; both ends are on it. A process that ends closes its pipes, and closed pipes end
 * the process, so neither end waits for one that is gone. */

#if defined(__APPLE__)
#define _DARWIN_C_SOURCE
#elif !defined(_WIN32)
#define _GNU_SOURCE
#endif
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

/* Bytes that grow. */
typedef struct {
  char *at;
  size_t length, capacity;
} fp_text;

static int fp_room(fp_text *t, size_t more) {
  if (t->capacity - t->length >= more) return 0;
  size_t wanted = 2 * t->capacity + more + 256;
  char *made = realloc(t->at, wanted);
  if (!made) return -1;
  t->at = made;
  t->capacity = wanted;
  return 0;
}

static int fp_append(fp_text *t, const void *bytes, size_t n) {
  if (!n) return 0;
  if (fp_room(t, n)) return -1;
  memcpy(t->at + t->length, bytes, n);
  t->length += n;
  return 0;
}

#define FP_MOST_SAID (1 << 20)

/* Keep what the process prints, the latest of it if it is very much. */
static void fp_hear(fp_text *said, const char *bytes, size_t n) {
  if (said->length + n > FP_MOST_SAID) said->length = 0;
  fp_append(said, bytes, n);
}

/* What each system does in its own way:
 *   fp_child                              a process
 *   fp_start(child, python, script, why)  start it; 0, or -1 and why not
 *   fp_send(child, bytes, n)              0, or -1 if it is gone
 *   fp_receive(child, text)               append what it sends, at least a byte; 0, or -1 if it is gone
 *   fp_heard(child, text)                 move what it printed until now
 *   fp_finish(child, why)                 end it if it still runs, and say how it ended
 *   fp_foreign(child)                     whether it belongs to another process than this one
 *   fp_own_file(path, size)               the path of this library
 *   fp_open(path)                         fopen for reading, the path in UTF-8 */
#define FP_PATH 4096
#define FP_WHY 400
#if defined(_WIN32)
#include "process_windows.c"
#else
#include "process_posix.c"
#endif

enum {
  FP_OPEN = 1, FP_SETUP, FP_ENTER, FP_LEAVE, FP_TERMINATE, FP_RESET, FP_GET_REAL, FP_GET_INTEGER, FP_SET_REAL, FP_NO_TYPE,
  FP_STEP, FP_TIME, FP_SAVE, FP_RESTORE, FP_FORGET, FP_WRITE, FP_READ, FP_CLOSE
};

enum { FP_GUID, FP_VERSION, FP_OLDEST, FP_PYTHON, FP_LINES };
static const char fp_hello[8] = "flexarm";

typedef struct {
  int64_t alive;
  fmi2CallbackFunctions call;
  int logging, running, last;
  fp_child child;
  fp_text request, answer, printed;
  const char *result;                      /* in the answer */
  size_t results;
  uint64_t process;                        /* how many processes this instance has had */
  char resources[FP_PATH], line[FP_LINES][FP_PATH], name[256];
} fp_instance;

/* A saved state is kept by the process; this is its number there, and its bytes once they are asked for. */
typedef struct {
  int64_t alive;
  fp_instance *owner;
  uint64_t process, number;
  fp_text bytes;
} fp_saved;

#define FP_ALIVE INT64_C(0x6d7261786c667970)
#define FP_SAVED INT64_C(0x6574617473667970)

/* -- messages --------------------------------------------------------------------------------------------------- */

#define FP_CATEGORIES 6
static const char *const fp_category[] = {"logAll", "logPython", "logStatusWarning", "logStatusDiscard", "logStatusError",
                                          "logEvents"};

/* Loggers may take the text for a format, and FMI gives # a meaning, so % and # are taken out. */
static void fp_log(const fp_instance *i, int status, int category, const char *function, const char *text, size_t n) {
  char line[2000];
  if (!i->call.logger || !(i->logging & (1 << category))) return;
  snprintf(line, sizeof line, "%s%s%.*s", function, *function ? ": " : "", (int)(n < 1900 ? n : 1900), text);
  for (char *at = line; *at; at++)
    if (*at == '%' || *at == '#') *at = '_';
  i->call.logger(i->call.componentEnvironment, i->name, (fmi2Status)status, fp_category[category], line);
}

static int fp_category_of(int status) {
  return status <= fmi2OK ? 1 : status == fmi2Warning ? 2 : status == fmi2Discard ? 3 : 4;
}

static fmi2Status fp_refuse(const fp_instance *i, fmi2Status status, const char *function, const char *text) {
  fp_log(i, status, fp_category_of(status), function, text, strlen(text));
  return status;
}

static fmi2Status fp_error(const fp_instance *i, const char *function, const char *text) {
  return fp_refuse(i, fmi2Error, function, text);
}

/* Pass on what Python code printed, line by line. */
static void fp_pass_on_printed(fp_instance *i) {
  fp_text *t = &i->printed;
  fp_heard(&i->child, t);
  for (size_t begin = 0; begin < t->length;) {
    const char *end = memchr(t->at + begin, '\n', t->length - begin);
    const size_t n = end ? (size_t)(end - t->at) - begin : t->length - begin;
    if (n) fp_log(i, fmi2OK, 1, "", t->at + begin, n);
    begin += n + 1;
  }
  t->length = 0;
}

/* -- the process ------------------------------------------------------------------------------------------------ */

/* Read an answer whole, behind `skipped` bytes; -1 if the process ends first or what it sends is no answer. */
static int fp_answer(fp_instance *i, size_t skipped, uint32_t head[3]) {
  for (;;) {
    if (i->answer.length >= skipped + 12) {
      memcpy(head, i->answer.at + skipped, 12);
      const uint64_t whole = (uint64_t)skipped + 12 + head[1] + head[2];
      if (i->answer.length > whole || head[0] > fmi2Error) return -1;
      if (i->answer.length == whole) break;
    }
    if (fp_receive(&i->child, &i->answer)) return -1;
  }
  i->result = i->answer.at + skipped + 12 + head[1];
  i->results = head[2];
  return 0;
}

/* End the process and say how it ended, with the end of what it printed. */
static void fp_lost(fp_instance *i, char *why, size_t size) {
  char how[FP_WHY];
  fp_finish(&i->child, how);
  fp_heard(&i->child, &i->printed);
  i->running = 0;
  const char *said = i->printed.at;
  size_t n = i->printed.length;
  while (n && (said[n - 1] == '\n' || said[n - 1] == '\r' || said[n - 1] == ' ')) n--;
  const size_t kept = n < 900 ? n : 900;
  if (kept) snprintf(why, size, "%s; its last words: %s%.*s", how, n > kept ? "..." : "", (int)kept, said + n - kept);
  else snprintf(why, size, "%s", how);
  i->printed.length = 0;
}

/* Ask the process, and pass its messages on. The result of a call that succeeds has `expected` bytes, or any if -1. */
static fmi2Status fp_ask(fp_instance *i, const char *f, uint32_t what, const void *first, size_t n, const void *second,
                         size_t m, long expected) {
  uint32_t head[3];
  char why[FP_WHY + 1000], text[FP_WHY + 1100];
  if (!i->running)
    return fp_error(i, f, "the Python process of this instance has ended; reset the instance to start another one");
  if (fp_foreign(&i->child))
    return fp_error(i, f, "the instance was made by another process, of which this one is a copy");
  if (n > UINT32_MAX / 4 || m > UINT32_MAX / 4) return fp_error(i, f, "too many values");
  const uint32_t request[2] = {what, (uint32_t)(n + m)};
  i->request.length = i->answer.length = 0;
  if (fp_append(&i->request, request, sizeof request) || fp_append(&i->request, first, n) ||
      fp_append(&i->request, second, m))
    return fp_error(i, f, "out of memory");
  if (fp_send(&i->child, i->request.at, i->request.length) || fp_answer(i, 0, head)) {
    fp_lost(i, why, sizeof why);
    snprintf(text, sizeof text, "the Python process ended %s", why);
    return fp_error(i, f, text);
  }
  fp_pass_on_printed(i);
  for (const char *at = i->answer.at + 12, *end = at + head[1]; end - at >= 8;) {
    uint32_t message[2];
    memcpy(message, at, 8);
    at += 8;
    if (message[1] > (size_t)(end - at)) break;
    fp_log(i, (int)message[0], fp_category_of((int)message[0]), f, at, message[1]);
    at += message[1];
  }
  if (head[0] <= fmi2Warning && expected >= 0 && i->results != (size_t)expected)
    return fp_error(i, f, "the Python process answers wrongly");
  return (fmi2Status)head[0];
}

/* Start a Python and see whether it will do; else -1 and why not. */
static int fp_try(fp_instance *i, const char *python, char *why, size_t size) {
  char script[FP_PATH + 10];
  uint32_t head[3];
  snprintf(script, sizeof script, "%s/start.py", i->resources);
  i->answer.length = i->printed.length = 0;
  char reason[FP_WHY];
  if (fp_start(&i->child, python, script, reason)) {
    snprintf(why, size, "cannot be started (%s)", reason);
    return -1;
  }
  i->running = 1;
  i->process++;
  if (fp_answer(i, sizeof fp_hello, head) || memcmp(i->answer.at, fp_hello, sizeof fp_hello)) {
    char how[FP_WHY + 1000];
    fp_lost(i, how, sizeof how);
    snprintf(why, size, "ended %s", how);
    return -1;
  }
  if (head[0] == fmi2OK) return 0;
  snprintf(why, size, "%.*s", (int)(i->results < 600 ? i->results : 600), i->result);
  fp_finish(&i->child, reason);
  fp_heard(&i->child, &i->printed);
  i->printed.length = 0;
  i->running = 0;
  return -1;
}

/* Start the process of an instance: FLEXARM_PYTHON if set, else the Python that exported, else that on the PATH. */
static fmi2Status fp_begin(fp_instance *i, const char *f) {
  char why[3][FP_WHY + 1000], text[1900];
  const char *const chosen = fp_environment("FLEXARM_PYTHON");
  const int given = chosen && *chosen;
  if (!fp_try(i, given ? chosen : i->line[FP_PYTHON], why[0], sizeof why[0]) ||
      (!given && !fp_try(i, FP_ON_PATH, why[1], sizeof why[1])))
    return fp_ask(i, f, FP_OPEN, i->name, strlen(i->name), 0, 0, 0);
  int n = snprintf(text, sizeof text, "no Python runs this FMU, which needs Python %.20s or newer with %.60s. Tried %s%.400s: %.500s",
                   i->line[FP_OLDEST], i->line[FP_VERSION], given ? "FLEXARM_PYTHON=" : "", given ? chosen : i->line[FP_PYTHON],
                   why[0]);
  if (!given) n += snprintf(text + n, sizeof text - (size_t)n, "; " FP_ON_PATH " on the PATH: %.500s", why[1]);
  snprintf(text + n, sizeof text - (size_t)n, ". Set the environment variable FLEXARM_PYTHON of the importer to the path of a "
           "Python that has it");
  return fp_error(i, f, text);
}

static void fp_close(fp_instance *i) {
  char why[FP_WHY];
  if (!i->running) return;
  if (!fp_foreign(&i->child)) {
    fp_ask(i, "fmi2FreeInstance", FP_CLOSE, 0, 0, 0, 0, 0);
    if (!i->running) return;
  }
  fp_finish(&i->child, why);
  i->printed.length = 0;
  fp_heard(&i->child, &i->printed);
  i->running = 0;
}

/* -- the resources ---------------------------------------------------------------------------------------------- */

/* Read the lines of python.txt in a folder; 0, or -1 if there is none. */
static int fp_read(fp_instance *i, const char *folder) {
  char path[FP_PATH + 20];
  snprintf(path, sizeof path, "%s/python.txt", folder);
  FILE *file = fp_open(path);
  if (!file) return -1;
  int lines = 0;
  while (lines < FP_LINES && fgets(i->line[lines], FP_PATH, file)) {
    i->line[lines][strcspn(i->line[lines], "\r\n")] = 0;
    lines++;
  }
  fclose(file);
  if (lines < FP_LINES) return -1;
  snprintf(i->resources, sizeof i->resources, "%s", folder);
  return 0;
}

static int fp_digit(char c) {
  return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

/* The folder that a URL such as file:///tmp/a%20b names. */
static void fp_decode(const char *url, char *path, size_t size) {
  size_t n = 0;
  const int coded = !strncmp(url, "file:", 5);
  if (coded) {
    url += 5;
    if (url[0] == '/' && url[1] == '/') {
      url += 2;
      while (*url && *url != '/') url++;                /* the host, mostly none */
    }
#if defined(_WIN32)
    if (url[0] == '/' && url[1] && url[2] == ':') url++;
#endif
  }
  for (; *url && n + 1 < size; url++) {
    const int a = coded && *url == '%' ? fp_digit(url[1]) : -1, b = a >= 0 ? fp_digit(url[2]) : -1;
    path[n++] = b >= 0 ? (char)(16 * a + b) : *url;
    if (b >= 0) url += 2;
  }
  while (n > 1 && (path[n - 1] == '/' || path[n - 1] == '\\')) n--;
  path[n] = 0;
}

/* Find the resources: where the importer says, or else beside this library: binaries/PLATFORM/this, resources. */
static int fp_find(fp_instance *i, const char *url) {
  char path[FP_PATH];
  if (url) {
    fp_decode(url, path, sizeof path);
    if (!fp_read(i, path)) return 0;
  }
  if (fp_own_file(path, sizeof path)) return -1;
  for (int up = 0; up < 3; up++) {
    char *slash = strrchr(path, '/'), *other = strrchr(path, '\\');
    if (other && (!slash || other > slash)) slash = other;
    if (!slash) return -1;
    *slash = 0;
  }
  if (strlen(path) + sizeof "/resources" > sizeof path) return -1;
  strcat(path, "/resources");
  return fp_read(i, path);
}

/* -- life ------------------------------------------------------------------------------------------------------- */

static fp_instance *fp_as_instance(void *c) {
  fp_instance *i = c;
  return i && i->alive == FP_ALIVE ? i : 0;
}

#define FP_INSTANCE                       \
  fp_instance *i = fp_as_instance(c);     \
  if (!i) return fmi2Error;

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

static void fp_discard(fp_instance *i) {
  i->alive = 0;
  free(i->request.at);
  free(i->answer.at);
  free(i->printed.at);
  free(i);
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
  (void)visible;
  if (!functions) return 0;
  fp_instance *i = calloc(1, sizeof *i);
  if (!i) return 0;
  i->alive = FP_ALIVE;
  i->call = *functions;
  i->logging = logging ? -1 : 1 << fp_category_of(fmi2Error);   /* why there is no instance is always told */
  snprintf(i->name, sizeof i->name, "%s", name ? name : "");
  const char *wrong = 0;
  if (!name || !*name) wrong = "the instance name is missing";
  else if (type != fmi2CoSimulation) wrong = "this FMU has Co-Simulation alone";
  else if (fp_find(i, resources)) wrong = "the FMU's resources are not found: unpack it whole and give fmuResourceLocation";
  else if (!guid || strcmp(guid, i->line[FP_GUID]))
    wrong = "the GUID is not that of modelDescription.xml; are the resources from another export?";
  if (wrong ? fp_error(i, __func__, wrong) : fp_begin(i, __func__)) {
    fp_close(i);
    fp_discard(i);
    return 0;
  }
  i->logging = logging ? -1 : 0;
  return i;
}

void fmi2FreeInstance(fmi2Component c) {
  fp_instance *i = fp_as_instance(c);
  if (!i) return;
  fp_close(i);
  fp_discard(i);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
  FP_INSTANCE
  int chosen = n ? 0 : -1;
  if (n && !categories) return fp_error(i, __func__, "categories is NULL");
  for (size_t k = 0; k < n; k++) {
    int found = 0;
    for (int j = 0; j < FP_CATEGORIES; j++)
      if (categories[k] && !strcmp(categories[k], fp_category[j])) found = j ? 1 << j : -1;
    if (!found) return fp_error(i, __func__, "unknown log category");
    chosen |= found;
  }
  i->logging = on ? i->logging | chosen : i->logging & ~chosen;
  return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean with_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean with_stop, fmi2Real stop) {
  FP_INSTANCE
  const double given[5] = {with_tolerance != 0, tolerance, start, with_stop != 0, stop};
  return fp_ask(i, __func__, FP_SETUP, given, sizeof given, 0, 0, 0);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  FP_INSTANCE
  return fp_ask(i, __func__, FP_ENTER, 0, 0, 0, 0, 0);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  FP_INSTANCE
  return fp_ask(i, __func__, FP_LEAVE, 0, 0, 0, 0, 0);
}

fmi2Status fmi2Terminate(fmi2Component c) {
  FP_INSTANCE
  return fp_ask(i, __func__, FP_TERMINATE, 0, 0, 0, 0, 0);
}

fmi2Status fmi2Reset(fmi2Component c) {
  FP_INSTANCE
  i->last = fmi2OK;
  return i->running ? fp_ask(i, __func__, FP_RESET, 0, 0, 0, 0, 0) : fp_begin(i, __func__);
}

/* -- values ----------------------------------------------------------------------------------------------------- */

static fmi2Status fp_get(fp_instance *i, const char *f, uint32_t what, const fmi2ValueReference *vr, size_t n, void *value,
                         size_t each) {
  if (!n) return fmi2OK;
  if (!vr || !value) return fp_error(i, f, "the references or values are NULL");
  if (n > UINT32_MAX / 64) return fp_error(i, f, "too many values");
  const fmi2Status status = fp_ask(i, f, what, vr, n * sizeof *vr, 0, 0, (long)(n * each));
  if (status <= fmi2Warning) memcpy(value, i->result, n * each);
  return status;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
  FP_INSTANCE
  return fp_get(i, __func__, FP_GET_REAL, vr, n, value, sizeof *value);
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
  FP_INSTANCE
  return fp_get(i, __func__, FP_GET_INTEGER, vr, n, value, sizeof *value);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
  FP_INSTANCE
  if (!n) return fmi2OK;
  if (!vr || !value) return fp_error(i, __func__, "the references or values are NULL");
  if (n > UINT32_MAX / 64) return fp_error(i, __func__, "too many values");
  return fp_ask(i, __func__, FP_SET_REAL, vr, n * sizeof *vr, value, n * sizeof *value, 0);
}

/* There are no variables that can be used so: the process says which one it is. */
#define FP_UNSUPPORTED_TYPE(name, type)                                                          \
  fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[]) {      \
    (void)value;                                                                                 \
    FP_INSTANCE                                                                                  \
    if (!n) return fmi2OK;                                                                       \
    if (!vr) return fp_error(i, __func__, "the references are NULL");                            \
    return fp_ask(i, __func__, FP_NO_TYPE, vr, sizeof *vr, 0, 0, 0);                             \
  }

FP_UNSUPPORTED_TYPE(fmi2GetBoolean, fmi2Boolean)
FP_UNSUPPORTED_TYPE(fmi2GetString, fmi2String)
FP_UNSUPPORTED_TYPE(fmi2SetInteger, const fmi2Integer)
FP_UNSUPPORTED_TYPE(fmi2SetBoolean, const fmi2Boolean)
FP_UNSUPPORTED_TYPE(fmi2SetString, const fmi2String)

#define FP_NO_DERIVATIVES "this FMU gives and takes no derivatives, as modelDescription.xml says"

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                        const fmi2ValueReference known[], size_t knowns, const fmi2Real along[],
                                        fmi2Real result[]) {
  (void)unknown; (void)unknowns; (void)known; (void)knowns; (void)along; (void)result;
  FP_INSTANCE
  return fp_error(i, __func__, FP_NO_DERIVATIVES);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
  (void)vr; (void)order; (void)value;
  FP_INSTANCE
  return n ? fp_error(i, __func__, FP_NO_DERIVATIVES) : fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
  (void)vr; (void)order; (void)value;
  FP_INSTANCE
  return n ? fp_error(i, __func__, FP_NO_DERIVATIVES) : fmi2OK;
}

/* -- saved states ----------------------------------------------------------------------------------------------- */

static int fp_is_saved(const void *state) { return state && ((const fp_saved *)state)->alive == FP_SAVED; }

/* Whether the instance holds the state; else it says why not. */
static int fp_holds(const fp_instance *i, const char *f, const fp_saved *s) {
  if (!fp_is_saved(s)) fp_error(i, f, "the state is NULL or was freed");
  else if (s->owner != i) fp_error(i, f, "the state is that of another instance; serialize it there to carry it over");
  else if (s->process != i->process) fp_error(i, f, "the state was lost with the Python process that held it");
  else return 1;
  return 0;
}

static void fp_forget(fp_instance *i, const fp_saved *s) {
  if (i->running && s->owner == i && s->process == i->process)
    fp_ask(i, "fmi2FreeFMUstate", FP_FORGET, &s->number, sizeof s->number, 0, 0, 0);
}

/* Put a new number into a state, made if there is none. */
static fmi2Status fp_numbered(fp_instance *i, const char *f, fmi2FMUstate *state) {
  uint64_t number;
  memcpy(&number, i->result, sizeof number);
  fp_saved *s = fp_is_saved(*state) ? (fp_saved *)*state : calloc(1, sizeof *s);
  if (!s) return fp_error(i, f, "out of memory");
  if (s->alive == FP_SAVED) fp_forget(i, s);
  s->alive = FP_SAVED;
  s->owner = i;
  s->process = i->process;
  s->number = number;
  s->bytes.length = 0;
  *state = s;
  return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
  FP_INSTANCE
  if (!state) return fp_error(i, __func__, "the state is NULL");
  const fmi2Status status = fp_ask(i, __func__, FP_SAVE, 0, 0, 0, 0, sizeof(uint64_t));
  return status > fmi2Warning ? status : fp_numbered(i, __func__, state);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  FP_INSTANCE
  const fp_saved *s = state;
  if (!fp_holds(i, __func__, s)) return fmi2Error;
  return fp_ask(i, __func__, FP_RESTORE, &s->number, sizeof s->number, 0, 0, 0);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
  FP_INSTANCE
  if (!state || !*state) return fmi2OK;
  fp_saved *s = *state;
  if (!fp_is_saved(s)) return fp_error(i, __func__, "the state was freed already");
  fp_forget(i, s);
  s->alive = 0;
  free(s->bytes.at);
  free(s);
  *state = 0;
  return fmi2OK;
}

/* Have the state's bytes at hand. */
static fmi2Status fp_write(fp_instance *i, const char *f, fp_saved *s) {
  if (!fp_is_saved(s)) return fp_error(i, f, "the state is NULL or was freed");
  if (s->bytes.length) return fmi2OK;
  if (!fp_holds(i, f, s)) return fmi2Error;
  const fmi2Status status = fp_ask(i, f, FP_WRITE, &s->number, sizeof s->number, 0, 0, -1);
  if (status > fmi2Warning) return status;
  return fp_append(&s->bytes, i->result, i->results) ? fp_error(i, f, "out of memory") : fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
  FP_INSTANCE
  if (!size) return fp_error(i, __func__, "the size is NULL");
  const fmi2Status status = fp_write(i, __func__, state);
  if (status == fmi2OK) *size = ((const fp_saved *)state)->bytes.length;
  return status;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
  FP_INSTANCE
  if (!bytes) return fp_error(i, __func__, "the buffer is NULL");
  const fmi2Status status = fp_write(i, __func__, state);
  if (status > fmi2Warning) return status;
  const fp_text *held = &((const fp_saved *)state)->bytes;
  if (size < held->length) return fp_error(i, __func__, "the buffer is too small");
  memcpy(bytes, held->at, held->length);
  return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
  FP_INSTANCE
  if (!bytes || !state) return fp_error(i, __func__, "the buffer or state is NULL");
  const fmi2Status status = fp_ask(i, __func__, FP_READ, bytes, size, 0, 0, sizeof(uint64_t));
  return status > fmi2Warning ? status : fp_numbered(i, __func__, state);
}

/* -- steps ------------------------------------------------------------------------------------------------------ */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real length, fmi2Boolean no_return) {
  (void)no_return;
  FP_INSTANCE
  const double given[2] = {now, length};
  const fmi2Status status = fp_ask(i, __func__, FP_STEP, given, sizeof given, 0, 0, 0);
  i->last = (int)status;
  return status;
}

fmi2Status fmi2CancelStep(fmi2Component c) {
  FP_INSTANCE
  return fp_error(i, __func__, "steps are never pending");
}

static fmi2Status fp_no_status(const fp_instance *i, const char *f) {
  return fp_refuse(i, fmi2Discard, f, "no such status");
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
  FP_INSTANCE
  if (kind != fmi2DoStepStatus || !value) return fp_no_status(i, __func__);
  *value = (fmi2Status)i->last;
  return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
  FP_INSTANCE
  if (kind != fmi2LastSuccessfulTime || !value) return fp_no_status(i, __func__);
  const fmi2Status status = fp_ask(i, __func__, FP_TIME, 0, 0, 0, 0, sizeof *value);
  if (status <= fmi2Warning) memcpy(value, i->result, sizeof *value);
  return status;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
  (void)kind; (void)value;
  FP_INSTANCE
  return fp_no_status(i, __func__);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
  FP_INSTANCE
  if (kind != fmi2Terminated || !value) return fp_no_status(i, __func__);
  *value = fmi2False;
  return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
  FP_INSTANCE
  if (kind != fmi2PendingStatus || !value) return fp_no_status(i, __func__);
  *value = "";
  return fmi2OK;
}
