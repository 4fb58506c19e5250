/* Calls an observer with numbers of every kind and checks what its header says: fuzz SEED CALLS. */
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "law_observer.h"

#if defined(LAW_OBSERVER_PARAMETERS)
#define GIVEN LAW_OBSERVER_PARAMETERS
#include "bounds.h"
static const law_real low[GIVEN] = LOW, high[GIVEN] = HIGH;
#elif defined(LAW_OBSERVER_VERTICES)
#define GIVEN LAW_OBSERVER_VERTICES
#endif
#define STATES LAW_STATES
#define INPUTS LAW_INPUTS
#define MEASURED LAW_OBSERVER_MEASURED

static uint64_t state = 1U;

static uint64_t draw(uint64_t count)
{
    state ^= state << 13U;
    state ^= state >> 7U;
    state ^= state << 17U;
    return (state >> 11U) % count;
}

static law_real ordinary(void)
{
    return (law_real)((double)draw(2000001U) / 1e6 - 1.0);
}

static law_real any(void)
{
    const law_real kinds[] = {
        (law_real)0, (law_real)-0.0, (law_real)NAN, (law_real)INFINITY, (law_real)-INFINITY,
        (sizeof(law_real) == 4U) ? (law_real)FLT_MAX : (law_real)DBL_MAX,
        (sizeof(law_real) == 4U) ? (law_real)-FLT_MAX : (law_real)-DBL_MAX,
        (law_real)1e-42, (law_real)-1e30, (law_real)1,
    };

    return kinds[draw(sizeof kinds / sizeof kinds[0])];
}

/* Usually all ordinary; else one or all of any kind. */
static bool fill(law_real *values, unsigned count)
{
    const uint64_t kind = draw(6U);
    bool finite = true;

    for (unsigned k = 0U; k < count; k++) {
        values[k] = (kind == 0U) ? any() : ordinary();
    }
    if (kind == 1U) {
        values[draw(count)] = any();
    }
    for (unsigned k = 0U; k < count; k++) {
        finite = finite && isfinite(values[k]);
    }
    return finite;
}

static uint32_t update(law_observer *o, const law_real *given, const law_real *u, const law_real *y)
{
#ifdef GIVEN
    return law_observer_update(o, given, u, y);
#else
    (void)given;
    return law_observer_update(o, u, y);
#endif
}

#define HOLDS(condition, what) \
    do { \
        if (!(condition)) { \
            printf("call %lu: %s; flags %u\n", call, what, (unsigned)flags); \
            exit(1); \
        } \
    } while (0)

/* What the flags must say of the given, and in same what must lead to the same estimate. */
static uint32_t expected(law_real *given, law_real *same)
{
    uint32_t flags = LAW_OBSERVER_OK;
#if defined(LAW_OBSERVER_PARAMETERS)
    const uint64_t kind = draw(4U);

    for (unsigned k = 0U; k < GIVEN; k++) {
        given[k] = (kind == 0U) ? any() : low[k] + (ordinary() + (law_real)1) / (law_real)2 * (high[k] - low[k]);
        if ((kind == 1U) && (draw(2U) == 0U)) {
            given[k] = (draw(2U) == 0U) ? low[k] - (law_real)1 : high[k] + (law_real)1;
        }
        same[k] = given[k];
        if (isnan(given[k])) {
            flags |= LAW_OBSERVER_NOT_A_NUMBER;
            same[k] = (law_real)0.5 * (low[k] + high[k]);
        } else if (given[k] < low[k]) {
            flags |= LAW_OBSERVER_CLAMPED;
            same[k] = low[k];
        } else if (given[k] > high[k]) {
            flags |= LAW_OBSERVER_CLAMPED;
            same[k] = high[k];
        }
    }
#elif defined(LAW_OBSERVER_VERTICES)
    const uint64_t kind = draw(3U);

    /* one vertex with all the weight; twice it is the same; NaN or no weight is the middle */
    for (unsigned k = 0U; k < GIVEN; k++) {
        given[k] = (law_real)0;
        same[k] = (law_real)0;
    }
    if (kind == 2U) {
        given[0] = (draw(2U) == 0U) ? (law_real)NAN : (law_real)0;
        flags = LAW_OBSERVER_NOT_A_NUMBER;
        for (unsigned k = 0U; k < GIVEN; k++) {
            same[k] = (law_real)1 / (law_real)GIVEN;
        }
    } else {
        const uint64_t j = draw(GIVEN);

        given[j] = (law_real)(kind + 1U);
        same[j] = (law_real)1;
        flags = (kind == 1U) ? LAW_OBSERVER_CLAMPED : LAW_OBSERVER_OK;
    }
#else
    (void)given;
    (void)same;
#endif
    return flags;
}

int main(int argc, char **argv)
{
    unsigned long counts[3] = {0U, 0U, 0U};

    if (argc != 3) {
        return 2;
    }
    state += (uint64_t)atol(argv[1]);
    for (unsigned long call = 0U; call < (unsigned long)atol(argv[2]); call++) {
        /* of exact size, so that an index beyond is seen */
        law_real *u = malloc(INPUTS * sizeof *u), *y = malloc(MEASURED * sizeof *y);
        law_real *x = malloc(STATES * sizeof *x);
        law_observer *observer = malloc(sizeof *observer), *again = malloc(sizeof *again);
#ifdef GIVEN
        law_real *given = malloc(GIVEN * sizeof *given), *same = malloc(GIVEN * sizeof *same);
#else
        law_real *given = NULL, *same = NULL;
#endif
        const bool held = fill(x, STATES), driven = fill(u, INPUTS), seen = fill(y, MEASURED);
        const uint32_t wanted = expected(given, same);
        uint32_t flags = 0U, plain;
        bool zero = true;

        law_observer_start(observer, x);
        for (unsigned i = 0U; i < STATES; i++) {
            HOLDS(observer->x[i] == (held ? x[i] : (law_real)0), "started elsewhere");
        }
        memcpy(observer->x, x, sizeof observer->x);
        flags = update(observer, given, u, y);
        HOLDS((flags & 3U) == wanted, "flags of the parameters");
        HOLDS(((flags & LAW_OBSERVER_NO_MEASUREMENT) != 0U) == !seen, "flag of y");
        HOLDS(((flags & LAW_OBSERVER_NO_INPUT) != 0U) == !driven, "flag of u");
        HOLDS(flags < 32U, "another flag");
        for (unsigned i = 0U; i < STATES; i++) {
            HOLDS(isfinite(observer->x[i]), "not finite");
            zero = zero && (observer->x[i] == (law_real)0);
        }
        if (!held) {
            HOLDS((flags & LAW_OBSERVER_RESTARTED) != 0U, "no restart from what is not finite");
        }
        if ((flags & LAW_OBSERVER_RESTARTED) != 0U) {
            HOLDS(zero, "restarted elsewhere");
            counts[0]++;
        } else {
            counts[1]++;
        }
        /* a u that is not finite is 0, and a parameter off its interval the nearer bound */
        memcpy(again->x, x, sizeof again->x);
        for (unsigned j = 0U; j < INPUTS; j++) {
            u[j] = driven ? u[j] : (law_real)0;
        }
        plain = update(again, same, u, y);
        HOLDS((plain | wanted | (driven ? 0U : LAW_OBSERVER_NO_INPUT)) == flags, "flags again");
        HOLDS(memcmp(again->x, observer->x, sizeof again->x) == 0, "another estimate");
        /* what y is makes no difference once one of it is not finite */
        if (!seen) {
            memcpy(again->x, x, sizeof again->x);
            for (unsigned j = 0U; j < MEASURED; j++) {
                y[j] = (law_real)NAN;
            }
            (void)update(again, same, u, y);
            HOLDS(memcmp(again->x, observer->x, sizeof again->x) == 0, "half a measurement");
            counts[2]++;
        }
        free(u);
        free(y);
        free(x);
        free(observer);
        free(again);
        free(given);
        free(same);
    }
    printf("%lu restarted, %lu not, %lu without y\n", counts[0], counts[1], counts[2]);
    return ((counts[0] > 0U) && (counts[1] > 0U) && (counts[2] > 0U)) ? 0 : 3;
}
