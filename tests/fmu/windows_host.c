/* Runs the Windows binary of an FMI 2 FMU: host LIBRARY GUID STEPS INPUT OUTPUT... prints the outputs at the end. The input
 * is 1.5 and set unless INPUT is 0; a step takes 1 ms. */

#include <stdio.h>
#include <stdlib.h>
#include <windows.h>

#include "fmi2Functions.h"

static void logger(fmi2ComponentEnvironment e, fmi2String name, fmi2Status s, fmi2String c, fmi2String text, ...) {
  (void)e; (void)s; (void)c;
  fprintf(stderr, "%s: %s\n", name, text);
}

static const fmi2CallbackFunctions calls = {logger, calloc, free, 0, 0};

static FARPROC find(HMODULE library, const char *name) {
  FARPROC found = GetProcAddress(library, name);
  if (!found) { fprintf(stderr, "no %s\n", name); exit(3); }
  return found;
}

int main(int count, char **words) {
  if (count < 6) return 2;
  HMODULE library = LoadLibraryA(words[1]);
  if (!library) { fprintf(stderr, "error %lu\n", GetLastError()); return 3; }
  const fmi2ValueReference input = (fmi2ValueReference)atoi(words[4]);
  const double volt = 1.5;
  fmi2Component c = ((fmi2InstantiateTYPE *)find(library, "fmi2Instantiate"))("arm", fmi2CoSimulation, words[2], 0, &calls, 0, 0);
  if (!c) return 4;
  if (((fmi2SetupExperimentTYPE *)find(library, "fmi2SetupExperiment"))(c, 0, 0, 0, 0, 0)) return 5;
  if (((fmi2EnterInitializationModeTYPE *)find(library, "fmi2EnterInitializationMode"))(c)) return 5;
  if (input && ((fmi2SetRealTYPE *)find(library, "fmi2SetReal"))(c, &input, 1, &volt)) return 5;
  if (((fmi2ExitInitializationModeTYPE *)find(library, "fmi2ExitInitializationMode"))(c)) return 5;
  fmi2DoStepTYPE *step = (fmi2DoStepTYPE *)find(library, "fmi2DoStep");
  for (long k = 0; k < atol(words[3]); k++)
    if (step(c, (double)k * 1e-3, 1e-3, fmi2True)) return 6;
  for (int i = 5; i < count; i++) {
    const fmi2ValueReference output = (fmi2ValueReference)atoi(words[i]);
    double y;
    if (((fmi2GetRealTYPE *)find(library, "fmi2GetReal"))(c, &output, 1, &y)) return 7;
    printf("%.17g\n", y);
  }
  ((fmi2FreeInstanceTYPE *)find(library, "fmi2FreeInstance"))(c);
  return 0;
}
