/* The functions of FMI 2 that the small FMUs of other makers do not have; FMPy binds them all. */
API int fmi2GetInteger(void *c, const unsigned *r, size_t n, int *v) { return 3; }
API int fmi2GetBoolean(void *c, const unsigned *r, size_t n, int *v) { return 3; }
API int fmi2GetString(void *c, const unsigned *r, size_t n, const char **v) { return 3; }
API int fmi2SetInteger(void *c, const unsigned *r, size_t n, const int *v) { return 3; }
API int fmi2SetBoolean(void *c, const unsigned *r, size_t n, const int *v) { return 3; }
API int fmi2SetString(void *c, const unsigned *r, size_t n, const char *const *v) { return 3; }
API int fmi2GetFMUstate(void *c, void **s) { return 3; }
API int fmi2SetFMUstate(void *c, void *s) { return 3; }
API int fmi2FreeFMUstate(void *c, void **s) { return 3; }
API int fmi2SerializedFMUstateSize(void *c, void *s, size_t *n) { return 3; }
API int fmi2SerializeFMUstate(void *c, void *s, char *b, size_t n) { return 3; }
API int fmi2DeSerializeFMUstate(void *c, const char *b, size_t n, void **s) { return 3; }
API int fmi2GetDirectionalDerivative(void *c, const unsigned *u, size_t n, const unsigned *k, size_t m, const double *d,
                                     double *v) { return 3; }
API int fmi2SetRealInputDerivatives(void *c, const unsigned *r, size_t n, const int *o, const double *v) { return 3; }
API int fmi2GetRealOutputDerivatives(void *c, const unsigned *r, size_t n, const int *o, double *v) { return 3; }
API int fmi2CancelStep(void *c) { return 3; }
API int fmi2GetStatus(void *c, int k, int *v) { return 3; }
API int fmi2GetRealStatus(void *c, int k, double *v) { return 3; }
API int fmi2GetIntegerStatus(void *c, int k, int *v) { return 3; }
API int fmi2GetBooleanStatus(void *c, int k, int *v) { return 3; }
API int fmi2GetStringStatus(void *c, int k, const char **v) { return 3; }
