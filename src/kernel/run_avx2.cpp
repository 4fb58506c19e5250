// Compiled with -mavx2 -mfma; called only where the processor has both.
#define POLEFENCE_RUN run_avx2
#define POLEFENCE_MINIMUM minimum_avx2
#define POLEFENCE_INSIDE inside_avx2
#include "run.inc"
