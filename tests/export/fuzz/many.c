/* Many updates in one call, for Python: row by row. */
#include "law.h"

#ifdef LAW_MEASURED /* signals y in place of the states */
#define LAW_STATES LAW_MEASURED
#endif

#if defined(LAW_PARAMETERS)
#define GIVEN LAW_PARAMETERS
#elif defined(LAW_VERTICES)
#define GIVEN LAW_VERTICES
#endif

void many(uint32_t count, const law_real *given, const law_real *x, law_real *u, uint32_t *flags)
{
    for (uint32_t k = 0U; k < count; k++) {
#ifdef GIVEN
        flags[k] = law_update(&given[k * GIVEN], &x[k * LAW_STATES], &u[k * LAW_INPUTS]);
#else
        (void)given;
        flags[k] = law_update(&x[k * LAW_STATES], &u[k * LAW_INPUTS]);
#endif
    }
}
