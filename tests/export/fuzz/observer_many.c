/* Many steps of an observer in one call, for Python: row by row, from an estimate to the next. */
#include "law_observer.h"

#if defined(LAW_OBSERVER_PARAMETERS)
#define GIVEN LAW_OBSERVER_PARAMETERS
#elif defined(LAW_OBSERVER_VERTICES)
#define GIVEN LAW_OBSERVER_VERTICES
#endif

void many(uint32_t count, const law_real *given, const law_real *u, const law_real *y, law_real *x,
          uint32_t *flags)
{
    for (uint32_t k = 0U; k < count; k++) {
        law_observer observer;

        for (uint32_t i = 0U; i < LAW_STATES; i++) {
            observer.x[i] = x[(k * LAW_STATES) + i];
        }
#ifdef GIVEN
        flags[k] = law_observer_update(&observer, &given[k * GIVEN], &u[k * LAW_INPUTS],
                                       &y[k * LAW_OBSERVER_MEASURED]);
#else
        (void)given;
        flags[k] = law_observer_update(&observer, &u[k * LAW_INPUTS],
                                       &y[k * LAW_OBSERVER_MEASURED]);
#endif
        for (uint32_t i = 0U; i < LAW_STATES; i++) {
            x[(k * LAW_STATES) + i] = observer.x[i];
        }
    }
}
