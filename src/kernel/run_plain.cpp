#define POLEFENCE_RUN run_plain
#define POLEFENCE_MINIMUM minimum_plain
#define POLEFENCE_INSIDE inside_plain
#include "run.inc"
