/* An FMI 2 Co-Simulation FMU of another maker: y = u, and what the parameter (reference 2) asks for besides. */
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define API __attribute__((visibility("default")))
typedef void (*logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct { logger log; void *allocate, *release, *finished, *environment; } callbacks;

enum { SOUND, NOT_A_NUMBER, NULL_LOG, SEGMENTATION, ABORTED, EXITED, PRINTING, READING, TALKING, INFINITE, HANGING, REFUSING };
static double value[3];
static const callbacks *back;
static int how(void) { return (int)value[2]; }

API const char *fmi2GetTypesPlatform(void) { return "default"; }
API const char *fmi2GetVersion(void) { return "2.0"; }
API void *fmi2Instantiate(const char *n, int k, const char *g, const char *r, const callbacks *c, int v, int l) {
  back = c;
  memset(value, 0, sizeof value);
  return value;
}
API void fmi2FreeInstance(void *c) {}
API int fmi2SetDebugLogging(void *c, int on, size_t n, const char *const *names) { return 0; }
API int fmi2SetupExperiment(void *c, int d, double t, double s, int e, double x) { return 0; }
API int fmi2EnterInitializationMode(void *c) { return 0; }
API int fmi2ExitInitializationMode(void *c) {
  if (how() == NULL_LOG) back->log(NULL, NULL, 0, NULL, NULL);
  return 0;
}
API int fmi2Terminate(void *c) { return 0; }
API int fmi2Reset(void *c) { return 0; }
API int fmi2GetReal(void *c, const unsigned *r, size_t n, double *v) {
  for (size_t i = 0; i < n; i++)
    v[i] = r[i] != 1 ? value[r[i]] : how() == NOT_A_NUMBER ? nan("") : how() == INFINITE ? HUGE_VAL : value[0];
  return 0;
}
API int fmi2SetReal(void *c, const unsigned *r, size_t n, const double *v) {
  for (size_t i = 0; i < n; i++) value[r[i]] = v[i];
  return 0;
}
API int fmi2DoStep(void *c, double t, double h, int no) {
  char text[100000];
  switch (how()) {
    case SEGMENTATION: *(volatile int *)8 = 1; break;
    case ABORTED: abort();
    case EXITED: _exit(0);
    case PRINTING: printf("[[\"{\n"); fflush(stdout); break;
    case READING: return getchar() == EOF ? 0 : 3;
    case TALKING:
      memset(text, '\xff', sizeof text);
      text[sizeof text - 1] = 0;
      for (int i = 0; i < 2000; i++) back->log(NULL, "x", 1, "c", text);
      break;
    case HANGING: for (;;) pause();
    case REFUSING: back->log(NULL, "x", 3, "c", "no more"); return 3;
  }
  return 0;
}
#include "foreign_unused.h"
