/* FMI 2.0: the functions of Model Exchange. Event indicators are the guards of the modes, two for each, positive while the
 * mode holds. */

fmi2Status fmi2EnterEventMode(fmi2Component c) {
  FA_IN(FA_EXCHANGING)
  i->core.now.phase = FA_EVENT;
  return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
  FA_IN(FA_BIT(FA_EVENT))
  int moved = 0;
  double next = 0;
  if (!info) return fa_no(i, __func__, "the event info is NULL");
  const int status = fa_do_discrete(i, __func__, &moved, &next);
  if (status) return status;
  memset(info, 0, sizeof *info);
  info->valuesOfContinuousStatesChanged = moved;
  info->nextEventTimeDefined = next < HUGE_VAL;
  info->nextEventTime = next < HUGE_VAL ? next : 0;
  return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) {
  FA_IN(FA_BIT(FA_EVENT))
  return fa_do_continuous(i, __func__);
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean final, fmi2Boolean *event, fmi2Boolean *end) {
  (void)final;
  FA_IN(FA_BIT(FA_CONTINUOUS))
  if (!event || !end) return fa_no(i, __func__, "an argument is NULL");
  *event = *end = fmi2False;
  return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
  FA_IN(FA_EXCHANGING)
  return fa_do_time(i, __func__, time);
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
  FA_IN(FA_BIT(FA_CONTINUOUS))
  return fa_do_array(i, __func__, FA_GIVE_X, 0, x, n);
}

#define FA_ARRAY(name, what)                                 \
  fmi2Status name(fmi2Component c, fmi2Real values[], size_t n) { \
    FA_IN(FA_STARTED | FA_BIT(FA_TERMINATED))                \
    return fa_do_array(i, __func__, what, values, 0, n);     \
  }

FA_ARRAY(fmi2GetDerivatives, FA_TAKE_RATES)
FA_ARRAY(fmi2GetEventIndicators, FA_TAKE_GUARDS)
FA_ARRAY(fmi2GetContinuousStates, FA_TAKE_X)
FA_ARRAY(fmi2GetNominalsOfContinuousStates, FA_TAKE_NOMINALS)
