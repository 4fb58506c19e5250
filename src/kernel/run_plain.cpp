#define POLEFENCE_RUN run_plain
#include "run.inc"
