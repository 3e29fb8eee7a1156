/* FMI 3.0: the functions for what this FMU has not; each says so and changes nothing. */

static fmi3Status fa_unsupported_function(fmi3Instance c, const char *function, const char *what) {
  fa_instance *i = fa_as_instance(c);
  return i ? fa_error(i, function, what) : fmi3Error;
}

/* Getting or setting no variables at all is no mistake. */
static fmi3Status fa_unsupported_type(fmi3Instance c, const char *function, const fmi3ValueReference *vr, size_t n) {
  fa_instance *i = fa_as_instance(c);
  return i ? fa_unsupported_variables(i, function, vr, n) : fmi3Error;
}

#define FA_UNSUPPORTED_TYPE(type)                                                                                     \
  fmi3Status fmi3Get##type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##type v[], size_t m) {       \
    (void)v; (void)m;                                                                                                 \
    return fa_unsupported_type(c, __func__, vr, n);                                                                   \
  }                                                                                                                   \
  fmi3Status fmi3Set##type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3##type v[], size_t m) { \
    (void)v; (void)m;                                                                                                 \
    return fa_unsupported_type(c, __func__, vr, n);                                                                   \
  }

FA_UNSUPPORTED_TYPE(Float32)
FA_UNSUPPORTED_TYPE(Int8)
FA_UNSUPPORTED_TYPE(UInt8)
FA_UNSUPPORTED_TYPE(Int16)
FA_UNSUPPORTED_TYPE(UInt16)
FA_UNSUPPORTED_TYPE(UInt32)
FA_UNSUPPORTED_TYPE(Int64)
FA_UNSUPPORTED_TYPE(UInt64)
FA_UNSUPPORTED_TYPE(Boolean)
FA_UNSUPPORTED_TYPE(String)

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName, fmi3String instantiationToken,
                                               fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                               fmi3InstanceEnvironment instanceEnvironment,
                                               fmi3LogMessageCallback logMessage, fmi3ClockUpdateCallback clockUpdate,
                                               fmi3LockPreemptionCallback lockPreemption,
                                               fmi3UnlockPreemptionCallback unlockPreemption) {
  (void)instanceName; (void)instantiationToken; (void)resourcePath; (void)visible; (void)loggingOn;
  (void)clockUpdate; (void)lockPreemption; (void)unlockPreemption;
  return fa_instantiation_failed(logMessage, instanceEnvironment, __func__,
                                 "this FMU is for Co-Simulation and Model Exchange");
}

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t valueSizes[], fmi3Binary v[],
                         size_t m) {
  (void)valueSizes; (void)v; (void)m;
  return fa_unsupported_type(c, __func__, vr, n);
}

fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Int32 v[], size_t m) {
  (void)v; (void)m;
  return fa_unsupported_type(c, __func__, vr, n);
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const size_t valueSizes[],
                         const fmi3Binary v[], size_t m) {
  (void)valueSizes; (void)v; (void)m;
  return fa_unsupported_type(c, __func__, vr, n);
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference valueReference,
                                               size_t *nDependencies) {
  (void)valueReference; (void)nDependencies;
  return fa_unsupported_function(c, __func__, "dependencies are those of modelDescription.xml");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent,
                                       size_t elementIndicesOfDependent[], fmi3ValueReference independents[],
                                       size_t elementIndicesOfIndependents[], fmi3DependencyKind dependencyKinds[],
                                       size_t nDependencies) {
  (void)dependent; (void)elementIndicesOfDependent; (void)independents; (void)elementIndicesOfIndependents;
  (void)dependencyKinds; (void)nDependencies;
  return fa_unsupported_function(c, __func__, "dependencies are those of modelDescription.xml");
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) {
  return fa_unsupported_function(c, __func__, "this FMU has no structural parameters");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) {
  return fa_unsupported_function(c, __func__, "this FMU has no structural parameters");
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[]) {
  (void)intervals; (void)qualifiers;
  return fa_unsupported_type(c, __func__, vr, n);
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
                                   fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]) {
  (void)counters; (void)resolutions; (void)qualifiers;
  return fa_unsupported_type(c, __func__, vr, n);
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 shifts[]) {
  (void)shifts;
  return fa_unsupported_type(c, __func__, vr, n);
}

fmi3Status fmi3GetShiftFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
                                fmi3UInt64 resolutions[]) {
  (void)counters; (void)resolutions;
  return fa_unsupported_type(c, __func__, vr, n);
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                  const fmi3Float64 intervals[]) {
  (void)intervals;
  return fa_unsupported_type(c, __func__, vr, n);
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                   const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]) {
  (void)counters; (void)resolutions;
  return fa_unsupported_type(c, __func__, vr, n);
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 shifts[]) {
  (void)shifts;
  return fa_unsupported_type(c, __func__, vr, n);
}

fmi3Status fmi3SetShiftFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 counters[],
                                const fmi3UInt64 resolutions[]) {
  (void)counters; (void)resolutions;
  return fa_unsupported_type(c, __func__, vr, n);
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clockReference, fmi3Float64 activationTime) {
  (void)clockReference; (void)activationTime;
  return fa_unsupported_function(c, __func__, "this FMU is for Co-Simulation and Model Exchange");
}
