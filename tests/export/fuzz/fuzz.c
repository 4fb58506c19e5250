/* Feeds a law with what sensors and faults may give, and holds every answer to the header's word.
 *
 * Compiled with law.c, and a bounds.h of LOW, HIGH (of the parameters) and LIMITS, each a list, for
 * what of it the law has. fuzz SEED COUNT; says what was wrong, and ends with 1.
 */
#include "law.h"

#include "bounds.h"

#ifdef LAW_MEASURED /* signals y in place of the states */
#define LAW_STATES LAW_MEASURED
#endif

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(LAW_PARAMETERS)
#define GIVEN LAW_PARAMETERS
static const law_real low[GIVEN] = LOW;
static const law_real high[GIVEN] = HIGH;
#elif defined(LAW_VERTICES)
#define GIVEN LAW_VERTICES
#endif
#ifdef LIMITS
static const double limits[LAW_INPUTS] = LIMITS;
#endif

static const law_real largest = (sizeof(law_real) == 4U) ? (law_real)FLT_MAX : (law_real)DBL_MAX;
static const law_real least = (sizeof(law_real) == 4U) ? (law_real)FLT_MIN : (law_real)DBL_MIN;

static uint64_t state;

static uint64_t draw(uint64_t below)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (state >> 11) % below;
}

static law_real ordinary(void)
{
    return (law_real)((double)draw(2000001U) / 1000000.0 - 1.0);
}

static law_real any(void)
{
    const law_real wild[] = {
        (law_real)NAN, (law_real)INFINITY, (law_real)-INFINITY, largest, -largest,
        least / (law_real)1024, -least / (law_real)1024, least, (law_real)0, (law_real)-0.0,
        (law_real)1e30, (law_real)-1e30, (law_real)1e-30, (law_real)1, largest / (law_real)2,
    };
    const uint64_t at = draw(2U * sizeof wild / sizeof wild[0]);

    return (at < sizeof wild / sizeof wild[0])
               ? wild[at]
               : (law_real)ldexp((double)ordinary(), (int)draw(200U) - 100);
}

static law_real beside(law_real value, law_real towards)
{
    return (sizeof(law_real) == 4U) ? (law_real)nextafterf((float)value, (float)towards)
                                    : (law_real)nextafter((double)value, (double)towards);
}

#ifdef LIMITS
/* The largest number that is not beyond a limit. */
static law_real cut(double limit)
{
    const law_real near = (law_real)limit;

    return ((double)near > limit) ? beside(near, (law_real)0) : near;
}
#endif

#ifdef GIVEN
/* What the flags must say; and in same, what must give the same u. */
static uint32_t expected(const law_real given[GIVEN], law_real same[GIVEN])
{
    uint32_t flags = LAW_OK;
#ifdef LAW_PARAMETERS
    for (unsigned k = 0U; k < GIVEN; k++) {
        same[k] = given[k];
        if (isnan(given[k])) {
            flags |= LAW_NOT_A_NUMBER;
            same[k] = (law_real)0.5 * (low[k] + high[k]);
        } else if (given[k] < low[k]) {
            flags |= LAW_CLAMPED;
            same[k] = low[k];
        } else if (given[k] > high[k]) {
            flags |= LAW_CLAMPED;
            same[k] = high[k];
        }
    }
#else
    law_real total = (law_real)0;
    bool finite = true;

    for (unsigned k = 0U; k < GIVEN; k++) {
        finite = finite && isfinite(given[k]);
        flags |= (given[k] < -LAW_LOOSE) ? LAW_CLAMPED : LAW_OK;
        same[k] = (given[k] > (law_real)0) ? given[k] : (law_real)0;
        total += same[k];
    }
    if (!finite || !(total >= (law_real)1e-30) || !(total <= (law_real)1e30)) {
        flags = LAW_NOT_A_NUMBER;
        for (unsigned k = 0U; k < GIVEN; k++) {
            same[k] = (k == 0U) ? (law_real)NAN : (law_real)1;
        }
    } else if (fabs((double)(total - (law_real)1)) > 1.001 * (double)LAW_LOOSE) {
        flags |= LAW_CLAMPED;
    } else if (fabs((double)(total - (law_real)1)) > 0.999 * (double)LAW_LOOSE) {
        flags |= 256U; /* at the edge: either */
    }
#endif
    return flags;
}

static void choose(law_real given[GIVEN])
{
    const uint64_t kind = draw(6U);

    for (unsigned k = 0U; k < GIVEN; k++) {
#ifdef LAW_PARAMETERS
        const law_real share = (ordinary() + (law_real)1) / (law_real)2;
        const law_real edges[] = {
            low[k], high[k], beside(low[k], -largest), beside(low[k], largest),
            beside(high[k], -largest), beside(high[k], largest),
        };

        given[k] = (kind == 0U)   ? any()
                   : (kind == 1U) ? edges[draw(sizeof edges / sizeof edges[0])]
                                  : low[k] + share * (high[k] - low[k]);
#else
        given[k] = (law_real)fabs((double)ordinary());
#endif
    }
#ifdef LAW_VERTICES
    law_real total = (law_real)0;

    for (unsigned k = 0U; k < GIVEN; k++) {
        total += given[k];
    }
    for (unsigned k = 0U; k < GIVEN; k++) {
        given[k] = ((kind == 3U) || !(total > (law_real)0)) ? given[k] : given[k] / total;
    }
    if (kind == 0U) {
        given[draw(GIVEN)] = any();
    } else if (kind == 1U) {
        given[draw(GIVEN)] -= LAW_LOOSE * (law_real)4 * ordinary();
    } else if ((kind == 2U) && (GIVEN > 1U)) {
        /* the others alone sum to one */
        for (unsigned k = 0U; k < GIVEN; k++) {
            given[k] = (law_real)1 / (law_real)(GIVEN - 1U);
        }
        given[draw(GIVEN)] = LAW_LOOSE * (law_real)4 * ordinary();
    } else if (kind == 4U) {
        const law_real size = any();

        for (unsigned k = 0U; k < GIVEN; k++) {
            given[k] *= size;
        }
    }
#endif
}
#endif

static uint32_t update(const law_real *given, const law_real *x, law_real *u)
{
#ifdef GIVEN
    return law_update(given, x, u);
#else
    (void)given;
    return law_update(x, u);
#endif
}

static void wrong(const char *what, uint32_t flags, const law_real *given, const law_real *x,
                  const law_real *u)
{
    printf("%s; flags %u\n", what, (unsigned)flags);
#ifdef GIVEN
    for (unsigned k = 0U; k < GIVEN; k++) {
        printf("given[%u] = %.17g\n", k, (double)given[k]);
    }
#else
    (void)given;
#endif
    for (unsigned k = 0U; k < LAW_STATES; k++) {
        printf("x[%u] = %.17g\n", k, (double)x[k]);
    }
    for (unsigned k = 0U; k < LAW_INPUTS; k++) {
        printf("u[%u] = %.17g\n", k, (double)u[k]);
    }
    exit(1);
}

#define HOLDS(condition, what) \
    do { \
        if (!(condition)) { \
            wrong(what, flags, given, x, u); \
        } \
    } while (0)

static void check(const law_real *given, const law_real *x, law_real *u, law_real *again)
{
    bool finite = true;
    bool small = true;
    uint32_t flags;

    for (unsigned k = 0U; k < LAW_STATES; k++) {
        finite = finite && isfinite(x[k]);
        small = small && (fabs((double)x[k]) < 1e-20 * (double)largest);
    }
    for (unsigned k = 0U; k < LAW_INPUTS; k++) {
        u[k] = (law_real)NAN;
    }
    flags = update(given, x, u);
    HOLDS(finite || (flags & LAW_NO_CONTROL) != 0U, "x not finite, and control");
    HOLDS(!small || (flags & LAW_NO_CONTROL) == 0U, "x small, and no control");
    for (unsigned k = 0U; k < LAW_INPUTS; k++) {
        HOLDS(isfinite(u[k]), "u not finite");
        HOLDS((flags & LAW_NO_CONTROL) == 0U || (u[k] <= 0 && u[k] >= 0), "no control, and u");
    }
#ifdef LIMITS
    bool at_limit = false;

    for (unsigned k = 0U; k < LAW_INPUTS; k++) {
        HOLDS(fabs((double)u[k]) <= limits[k], "u beyond its limit");
        at_limit = at_limit || (fabs((double)u[k]) >= (double)cut(limits[k]));
    }
    HOLDS(at_limit == ((flags & LAW_LIMITED) != 0U), "limited, and within");
    HOLDS((flags & (LAW_LIMITED | LAW_NO_CONTROL)) != (LAW_LIMITED | LAW_NO_CONTROL),
          "limited, and no control");
    const uint32_t others = LAW_NO_CONTROL | LAW_LIMITED;
#else
    const uint32_t others = LAW_NO_CONTROL;
#endif
#ifdef GIVEN
    law_real same[GIVEN];
    const uint32_t want = expected(given, same);
    const uint32_t either = ((want & 256U) != 0U) ? LAW_CLAMPED : 0U;

    HOLDS(((flags ^ want) & ~(others | either | 256U)) == 0U, "flags of what is given");
    const uint32_t second = update(same, x, again);
    HOLDS(((second ^ flags) & others) == 0U, "flags of x differ for what is taken instead");
    HOLDS(memcmp(again, u, LAW_INPUTS * sizeof *u) == 0, "u differs for what is taken instead");
#else
    (void)again;
    HOLDS((flags & ~others) == 0U, "flags");
#endif
}

int main(int count, char **arguments)
{
    long calls = (count == 3) ? strtol(arguments[2], NULL, 10) : 0;
    /* of the very size, so that a sanitizer sees the first number beyond */
    law_real *x = malloc(LAW_STATES * sizeof *x);
    law_real *u = malloc(LAW_INPUTS * sizeof *u);
    law_real *again = malloc(LAW_INPUTS * sizeof *u);
    law_real *given = NULL;

    state = (count == 3) ? strtoull(arguments[1], NULL, 10) * 2654435761U + 1U : 1U;
#ifdef GIVEN
    given = malloc(GIVEN * sizeof *given);
#endif
    if ((calls <= 0) || (x == NULL) || (u == NULL) || (again == NULL)) {
        return 2;
    }
    for (; calls > 0; calls--) {
        const uint64_t kind = draw(4U);

        for (unsigned k = 0U; k < LAW_STATES; k++) {
            x[k] = (kind == 0U) ? any() : ordinary();
            if (kind == 1U) {
                x[k] = (law_real)ldexp((double)x[k], (int)draw(100U) - 50);
            }
        }
        if (kind == 2U) {
            x[draw(LAW_STATES)] = any();
        }
#ifdef GIVEN
        choose(given);
#endif
        check(given, x, u, again);
    }
    free(x);
    free(u);
    free(again);
    free(given);
    return 0;
}
