/* FMI 2.0: the functions of Model Exchange. Event indicators are the guards of the modes, two for each, positive while the
 * mode holds. */

fmi2Status fmi2EnterEventMode(fmi2Component c) {
  FA_ALLOWED_IN(FA_MODEL_EXCHANGE_MODES)
  return fa_enter_event_mode(i, __func__);
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
  FA_ALLOWED_IN(FA_BIT(FA_EVENT_MODE))
  int moved = 0;
  double next = 0;
  if (!info) return fa_error(i, __func__, "the event info is NULL");
  const int status = fa_update_discrete_states(i, __func__, &moved, &next);
  if (status) return status;
  memset(info, 0, sizeof *info);
  info->valuesOfContinuousStatesChanged = moved;
  info->nextEventTimeDefined = next < HUGE_VAL;
  info->nextEventTime = next < HUGE_VAL ? next : 0;
  return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) {
  FA_ALLOWED_IN(FA_BIT(FA_EVENT_MODE))
  return fa_enter_continuous_time_mode(i, __func__);
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean final, fmi2Boolean *event, fmi2Boolean *end) {
  (void)final;
  FA_ALLOWED_IN(FA_BIT(FA_CONTINUOUS_TIME_MODE))
  if (!event || !end) return fa_error(i, __func__, "an argument is NULL");
  *event = *end = fmi2False;
  return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
  FA_ALLOWED_IN(FA_MODEL_EXCHANGE_MODES)
  return fa_set_time(i, __func__, time);
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
  FA_ALLOWED_IN(FA_BIT(FA_CONTINUOUS_TIME_MODE))
  return fa_get_or_set_array(i, __func__, FA_SET_STATES, 0, x, n);
}

#define FA_GET_ARRAY(name, what)                                 \
  fmi2Status name(fmi2Component c, fmi2Real values[], size_t n) { \
    FA_ALLOWED_IN(FA_ANY_MODE | FA_BIT(FA_TERMINATED))                \
    return fa_get_or_set_array(i, __func__, what, values, 0, n);     \
  }

FA_GET_ARRAY(fmi2GetDerivatives, FA_GET_DERIVATIVES)
FA_GET_ARRAY(fmi2GetEventIndicators, FA_GET_EVENT_INDICATORS)
FA_GET_ARRAY(fmi2GetContinuousStates, FA_GET_STATES)
FA_GET_ARRAY(fmi2GetNominalsOfContinuousStates, FA_GET_NOMINALS)
