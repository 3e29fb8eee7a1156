/* Steps an FMI 2 co-simulation in a C loop, so that nothing but its doStep is timed. */

typedef int do_step(void *component, double now, double length, int no_return);

int loop_run(do_step *step, void *component, long first, double length, long steps) {
  for (long k = first; k < first + steps; k++) {
    const int status = step(component, (double)k * length, length, 1);
    if (status) return status;
  }
  return 0;
}
