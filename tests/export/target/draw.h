/* Random inputs of an exported law named "law", the same bits as in Python (cortex.py, `drawn`).
 *
 * inputs.h has LOW and HIGH, what the code clamps its parameters to, where it takes parameters.
 */
#ifndef DRAW_H
#define DRAW_H

#include "law.h"

#ifdef LAW_MEASURED /* signals y in place of the states */
#define LAW_STATES LAW_MEASURED
#endif

#if defined(LAW_PARAMETERS)
#include "inputs.h"
#define GIVEN LAW_PARAMETERS
#elif defined(LAW_VERTICES)
#define GIVEN LAW_VERTICES
#endif

#if defined(GIVEN)
#define TYPES const law_real *, const law_real *, law_real *
#define VALUES(in, u) (in).given, (in).x, u
#else
#define GIVEN 1U /* not used */
#define TYPES const law_real *, law_real *
#define VALUES(in, u) (in).x, u
#endif

struct inputs {
    law_real given[GIVEN];
    law_real x[LAW_STATES];
};

static uint32_t drawn = 0U;
static uint32_t spare = 0U; /* bits that the last number did not use */

/* A hash of 32 bits, lowbias32 of C. Wellons. */
static uint32_t mixed(uint32_t n)
{
    n ^= n >> 16;
    n *= 0x7feb352dU;
    n ^= n >> 15;
    n *= 0x846ca68bU;
    return n ^ (n >> 16);
}

/* In [0, 1), with all digits of the format. */
static law_real uniform(void)
{
    const uint32_t high = mixed(drawn);
    const uint32_t low = mixed(drawn + 1U);

    drawn += 2U;
    spare = low & 63U;
    if (sizeof(law_real) == 4U) {
        return (law_real)(high >> 8) / (law_real)16777216.0;
    }
    return ((law_real)(high >> 5) * (law_real)67108864.0 + (law_real)(low >> 6)) /
           (law_real)9007199254740992.0;
}

#if defined(LAW_PARAMETERS) || defined(LAW_VERTICES)
/* The same, but an end of the interval every eighth time. */
static law_real share(void)
{
    const law_real value = uniform();

    if ((spare & 15U) < 2U) {
        return (law_real)(spare & 15U);
    }
    return value;
}
#endif

static void draw(struct inputs *next)
{
    static const law_real scale[4] = {
        (law_real)0.00048828125, (law_real)0.03125, (law_real)1.0, (law_real)1024.0};
    uint32_t j;
#if defined(LAW_PARAMETERS)
    for (j = 0U; j < GIVEN; j++) {
        next->given[j] = LOW[j] + ((HIGH[j] - LOW[j]) * share());
        if (next->given[j] > HIGH[j]) {
            next->given[j] = HIGH[j];
        }
    }
#elif defined(LAW_VERTICES)
    law_real total = (law_real)0.0;

    for (j = 0U; j < GIVEN; j++) {
        next->given[j] = share();
        total += next->given[j];
    }
    if (total <= (law_real)0.0) {
        next->given[0] = (law_real)1.0;
        total = (law_real)1.0;
    }
    for (j = 0U; j < GIVEN; j++) {
        next->given[j] /= total;
    }
#endif
    for (j = 0U; j < LAW_STATES; j++) {
        const law_real value = uniform();

        next->x[j] = (((law_real)2.0 * value) - (law_real)1.0) * scale[spare & 3U];
    }
}

#endif
