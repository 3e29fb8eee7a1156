/* Steps an FMI 2 co-simulation in a C loop, so that nothing but its doStep is timed. */

typedef int do_step(void *component, double now, double length, int no_return);

int loop_run(do_step *step, void *component, long first, double length, long steps) {
  for (long k = first; k < first + steps; k++) {
    const int status = step(component, (double)k * length, length, 1);
    if (status) return status;
  }
  return 0;
}

typedef int save_state(void *component, void **state);
typedef int set_state(void *component, void *state);

/* Saves the state and goes back to it, over and over. */
int loop_states(save_state *get, set_state *set, void *component, long times) {
  void *state = 0;
  for (long k = 0; k < times; k++) {
    int status = get(component, &state);
    if (!status) status = set(component, state);
    if (status) return status;
  }
  return 0;
}
