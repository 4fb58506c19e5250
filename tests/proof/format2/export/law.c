/* Written by polefence export; a new export overwrites it.
 *
 * plant
 *
 * (u, v) = K(c) (y, z), z its own states and v their rates, K a polynomial, c from the parameters, -1 to 1.
 *
 * K goes row by row; each of its entries is a polynomial, and has one coefficient a term.
 */
#include "law.h"

#include <float.h>
#include <stdbool.h>

/* What the law relies on; gcc keeps to it with -std=c99 and without -ffast-math. */
#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__)
#error "The law relies on the order of operations: compile without -ffast-math."
#endif
#if defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0)
#error "The law relies on NaN and infinity: compile without -ffinite-math-only."
#endif
#if defined(FLT_MANT_DIG) && (FLT_MANT_DIG != 24)
#error "The law relies on a float of 32 bits, as in IEEE 754."
#endif
#if defined(FLT_EVAL_METHOD) && (FLT_EVAL_METHOD != 0)
#error "The law relies on rounding after each operation, to no wider format."
#endif
#if !defined(__GNUC__) || defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif

#define MEASURED LAW_MEASURED
#define INPUTS LAW_INPUTS
#define ORDER LAW_ORDER
#define SIGNALS (MEASURED + ORDER) /* y and the law's own states, */
#define ROWS (INPUTS + ORDER) /* u and their rates */
#define TERMS 3U

/* An interval, and the scale that makes 0 to 1 of it:
 *   p[0]  m [kg], 1 to 2
 */
#define P0_LOW 1.0F
#define P0_HIGH 2.0F
#define P0_SCALE 2.0F

/* An interval, and the scale that makes 0 to 1 of it:
 *   p[1]  k [N/m], 4 to 20
 */
#define P1_LOW 4.0F
#define P1_HIGH 20.0F
#define P1_SCALE 0.0625F

static const law_real K[4][TERMS] = {
    { -36.0F, -4.5F, 2.25F },
    { 30.0F, 3.75F, -1.875F },
    { 10.0F, 1.25F, -0.625F },
    { -10.0F, -1.25F, 0.625F }
};

static const law_real LIMIT[INPUTS] = { 800.0F };

/* Every comparison with NaN is false, here and below. */
static bool is_finite(law_real value)
{
    return (value >= -FLT_MAX) && (value <= FLT_MAX);
}

/* The parameter, or what is taken in its place; says so in the flags. */
static law_real inside(law_real value, law_real low, law_real high, uint32_t *flags)
{
    law_real result = value;

    if ((value >= low) && (value <= high)) {
        /* inside */
    } else if (value < low) {
        result = low;
        *flags |= LAW_CLAMPED;
    } else if (value > high) {
        result = high;
        *flags |= LAW_CLAMPED;
    } else {
        /* NaN */
        result = 0.5F * (low + high);
        *flags |= LAW_NOT_A_NUMBER;
    }
    return result;
}

/* Rounding may lead a little beyond 0 and 1. */
static law_real fraction(law_real value)
{
    law_real result = value;

    if (value < 0.0F) {
        result = 0.0F;
    } else if (value > 1.0F) {
        result = 1.0F;
    } else {
        /* inside */
    }
    return result;
}

/* w: the powers of c, one a term. */
static uint32_t weigh(const law_real p[LAW_PARAMETERS], law_real w[TERMS])
{
    uint32_t flags = LAW_OK;
    law_real c[2];
    const law_real p0 = inside(p[0], P0_LOW, P0_HIGH, &flags);
    const law_real p1 = inside(p[1], P1_LOW, P1_HIGH, &flags);
    law_real ends[4];

    ends[1] = fraction(P0_SCALE * (p0 - P0_LOW) / p0);
    ends[0] = 1.0F - ends[1];
    ends[3] = fraction(P1_SCALE * (p1 - P1_LOW));
    ends[2] = 1.0F - ends[3];

    c[0] = ends[1] - ends[0];
    c[1] = ends[3] - ends[2];

    w[0] = 1.0F;
    w[1] = c[0];
    w[2] = c[1];
    return flags;
}

static law_real value_at(const law_real coefficients[TERMS], const law_real w[TERMS])
{
    law_real sum = coefficients[0] * w[0];
    uint32_t k;

    for (k = 1U; k < TERMS; k++) {
        sum += coefficients[k] * w[k];
    }
    return sum;
}

static law_real within(law_real value, law_real limit, uint32_t *flags)
{
    law_real result = value;

    if (value > limit) {
        result = limit;
        *flags |= LAW_LIMITED;
    } else if (value < -limit) {
        result = -limit;
        *flags |= LAW_LIMITED;
    } else {
        /* inside */
    }
    return result;
}

void law_reset(law_memory *memory)
{
    uint32_t i;

    for (i = 0U; i < ORDER; i++) {
        memory->x[i] = 0.0F;
    }
}

/* A row of the gain times the signals: of u, or of the rates. */
static law_real row_of(const law_real w[TERMS], uint32_t i, const law_real signals[SIGNALS])
{
    law_real sum = 0.0F;
    uint32_t j;

    for (j = 0U; j < SIGNALS; j++) {
        sum += value_at(K[(i * SIGNALS) + j], w) * signals[j];
    }
    return sum;
}

#define PASSES 3U /* the first leaves rounding, the others what that does to itself */
#define DEPENDENT 5.96046448e-08F /* of a row, what is left of one that others make up for */
#define ROUNDING 2.14576721e-06F /* of the sizes of u and what it is a sum of */

static law_real size_of(law_real value)
{
    return (value < 0.0F) ? -value : value;
}

uint32_t law_start(law_memory *memory,
                   const law_real p[LAW_PARAMETERS],
                   const law_real y[LAW_MEASURED],
                   const law_real u[LAW_INPUTS])
{
    law_real signals[SIGNALS];
    law_real asked[INPUTS];
    law_real left[INPUTS];
    law_real across[INPUTS][ORDER];
    law_real square[INPUTS];
    law_real w[TERMS];
    uint32_t flags = weigh(p, w);
    bool finite = true;
    uint32_t pass;
    uint32_t i;
    uint32_t j;
    uint32_t k;

    for (j = 0U; j < MEASURED; j++) {
        signals[j] = y[j];
    }
    for (k = 0U; k < ORDER; k++) {
        signals[MEASURED + k] = is_finite(memory->x[k]) ? memory->x[k] : 0.0F;
    }
    for (i = 0U; i < INPUTS; i++) {
        law_real whole = 0.0F;

        asked[i] = within(u[i], LIMIT[i], &flags);
        for (k = 0U; k < ORDER; k++) {
            across[i][k] = value_at(K[(i * SIGNALS) + MEASURED + k], w);
            whole += across[i][k] * across[i][k];
        }
        square[i] = 0.0F;
        for (k = 0U; k < ORDER; k++) {
            square[i] += across[i][k] * across[i][k];
        }
        if (!(square[i] > (DEPENDENT * whole))) {
            square[i] = 0.0F;
        }
    }
    for (pass = 0U; pass < PASSES; pass++) {
        for (i = 0U; i < INPUTS; i++) {
            left[i] = asked[i] - row_of(w, i, signals);
        }
        for (i = 0U; i < INPUTS; i++) {
            if (square[i] > 0.0F) {
                for (k = 0U; k < ORDER; k++) {
                    signals[MEASURED + k] += (left[i] / square[i]) * across[i][k];
                }
            } else {
                left[i] = 0.0F;
            }
        }
    }
    for (i = 0U; i < INPUTS; i++) {
        const law_real first = row_of(w, i, signals);
        law_real size = size_of(asked[i]);

        for (j = 0U; j < SIGNALS; j++) {
            size += size_of(value_at(K[(i * SIGNALS) + j], w) * signals[j]);
        }
        if (!is_finite(size) || !is_finite(first)) {
            finite = false;
        } else if (!(size_of(asked[i] - first) <= (ROUNDING * size))) {
            flags |= LAW_BUMP;
        } else {
            /* what is asked for */
        }
    }
    for (k = 0U; k < ORDER; k++) {
        if (!is_finite(signals[MEASURED + k])) {
            finite = false;
        }
    }
    if (finite) {
        for (k = 0U; k < ORDER; k++) {
            memory->x[k] = signals[MEASURED + k];
        }
    } else {
        flags = LAW_NO_CONTROL;
    }
    return flags;
}

uint32_t law_update(law_memory *memory,
                    const law_real p[LAW_PARAMETERS],
                    const law_real y[LAW_MEASURED],
                    law_real u[LAW_INPUTS])
{
    law_real signals[SIGNALS];
    law_real control[ROWS];
    law_real w[TERMS];
    uint32_t flags = weigh(p, w);
    bool measured = true;
    bool finite = true;
    uint32_t i;
    uint32_t j;

    for (j = 0U; j < MEASURED; j++) {
        signals[j] = y[j];
        if (!is_finite(y[j])) {
            measured = false;
        }
    }
    for (j = 0U; j < ORDER; j++) {
        signals[MEASURED + j] = memory->x[j];
    }
    for (i = 0U; i < ROWS; i++) {
        law_real sum = row_of(w, i, signals);

        if (i >= INPUTS) {
            /* a rate: what the state is at the next update */
            sum = memory->x[i - INPUTS] + (LAW_SAMPLE_TIME * sum);
        }
        control[i] = sum;
        if (!is_finite(sum)) {
            finite = false;
        }
    }
    /* u and the memory are written once, when all of it is known. */
    if (finite) {
        for (i = 0U; i < INPUTS; i++) {
            u[i] = within(control[i], LIMIT[i], &flags);
        }
        for (i = 0U; i < ORDER; i++) {
            memory->x[i] = control[INPUTS + i];
        }
    } else {
        for (i = 0U; i < INPUTS; i++) {
            u[i] = 0.0F;
        }
        flags |= LAW_NO_CONTROL;
        if (measured) {
            for (i = 0U; i < ORDER; i++) {
                memory->x[i] = 0.0F;
            }
            flags |= LAW_RESTARTED;
        }
    }
    return flags;
}
