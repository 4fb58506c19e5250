#define POLEFENCE_RUN run_plain
#define POLEFENCE_MINIMUM minimum_plain
#include "run.inc"
