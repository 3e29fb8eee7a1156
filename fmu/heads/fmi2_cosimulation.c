/* FMI 2.0: the functions of Co-Simulation. */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
  FA_ALLOWED_IN(FA_BIT(FA_INITIALIZATION_MODE) | FA_BIT(FA_STEP_MODE))
  return fa_set_input_derivatives(i, __func__, vr, n, order, value);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
  FA_ALLOWED_IN(FA_BIT(FA_STEP_MODE) | FA_BIT(FA_TERMINATED))
  return fa_get_output_derivatives(i, __func__, vr, n, order, value);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real length, fmi2Boolean no_return) {
  (void)no_return;
  FA_ALLOWED_IN(FA_BIT(FA_STEP_MODE))
  return fa_do_step(i, __func__, now, length);
}

fmi2Status fmi2CancelStep(fmi2Component c) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_error(i, __func__, "steps are never pending");
}

static int fa_invalid_status_kind(fa_instance *i, const char *f) {
  return fa_log_status(i, FA_STATUS_DISCARD, f, "no such status");
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  if (kind != fmi2DoStepStatus || !value) return fa_invalid_status_kind(i, __func__);
  *value = (fmi2Status)i->last;
  return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  if (kind != fmi2LastSuccessfulTime || !value) return fa_invalid_status_kind(i, __func__);
  *value = fa_time(i);
  return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
  (void)kind; (void)value;
  FA_ALLOWED_IN(FA_ANY_STATE)
  return fa_invalid_status_kind(i, __func__);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  if (kind != fmi2Terminated || !value) return fa_invalid_status_kind(i, __func__);
  *value = fmi2False;
  return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
  FA_ALLOWED_IN(FA_ANY_STATE)
  if (kind != fmi2PendingStatus || !value) return fa_invalid_status_kind(i, __func__);
  *value = "";
  return fmi2OK;
}
