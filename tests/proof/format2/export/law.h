/* Written by polefence export; a new export overwrites it.
 *
 * plant
 *
 * (u, v) = K(c) (y, z), z its own states and v their rates, K a polynomial, c from the parameters, -1 to 1.
 *
 * Proved in exact arithmetic: all poles of A + B K lie in half_plane(0.2), whatever the
 * parameters, with the gain as this code computes it and its own states step; its rounding
 * is at most 0.68 % of what is proved to leave them there.
 * Run every 10 ms, u one step late: with y measured the loop is proved to decay, at 0.861
 * 1/s or faster.
 * Sampled, not proved: at 10040 parameter values its poles, as log(z) / Ts, were in
 * half_plane(0.2), the slowest decay 0.878 1/s.
 * By trial, not proved: the region holds up to 100 ms, stability up to 116 ms.
 * At constant parameters, without underflow or limits.
 */
#ifndef LAW_H
#define LAW_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define LAW_MEASURED 1U
#define LAW_INPUTS 1U
#define LAW_ORDER 1U /* states of the law itself */
#define LAW_PARAMETERS 2U

/* The law's own states are stepped by it. */
/* From one update to the next [s], and from measuring y to applying u [samples], as judged. */
#define LAW_SAMPLE_TIME 0.00999999978F
#define LAW_DELAY 1U

typedef float law_real;

/* What an update returns: the sum of what happened. */
#define LAW_OK 0U

/* a parameter was outside its interval: the nearer bound was taken */
#define LAW_CLAMPED 1U

/* a parameter was NaN: the middle of its interval was taken */
#define LAW_NOT_A_NUMBER 2U

/* y was NaN or infinite, and the law's states are as they were; or see below: u is 0 */
#define LAW_NO_CONTROL 4U

/* an input was beyond its limit, and cut to it */
#define LAW_LIMITED 8U

/* y or the law's states were, or its states became, too large to compute with: its states
 * are 0 now, all of them, and so is u */
#define LAW_RESTARTED 16U

/* The law's own states, of one plant. */
typedef struct {
    law_real x[LAW_ORDER];
} law_memory;

/* Puts the law's states to 0. To be called before the first update. */
void law_reset(law_memory *memory);

/* the first u is farther from the one that is asked for than rounding: no states of the law give it */
#define LAW_BUMP 64U

/* Moves the law's states, as little as can be, to where the first update at this y answers the u that
 * is asked for, such as the one that acts now: so that nothing jumps where the law takes over, from a hand
 * or from another law. To be called before that update, after law_reset or in place of it.
 *
 * What the first update answers is computed, as it will be, and compared: LAW_BUMP where it is off by
 * more than rounding. Of several inputs that cannot all be had the first are. Later updates follow y
 * as ever; what is left of the start dies out as the loop does, with the law's own modes.
 * A u beyond its limit is asked for at the limit.
 *
 * Returns LAW_OK, or what happened; LAW_NO_CONTROL where a number is NaN, infinite or too large: the
 * states are then as they were.
 */
uint32_t law_start(law_memory *memory,
                   const law_real p[LAW_PARAMETERS],
                   const law_real y[LAW_MEASURED],
                   const law_real u[LAW_INPUTS]);

/* Computes the inputs u from the measured signals y and the parameters p.
 *
 * To be called once every LAW_SAMPLE_TIME: it takes the law's own states to the next update.
 *
 * Takes the same loops every time, keeps nothing but the memory, and may be called from several
 * tasks with memories of their own. u is finite whatever is given, and so are the states; both are
 * written at the end. No pointer may be null.
 *
 *   p[0]  m [kg], 1 to 2
 *   p[1]  k [N/m], 4 to 20
 *   y[0]  position [m]
 *   u[0]  force [N]
 *         within -800 to 800
 *
 * Returns LAW_OK, or what happened.
 */
uint32_t law_update(law_memory *memory,
                    const law_real p[LAW_PARAMETERS],
                    const law_real y[LAW_MEASURED],
                    law_real u[LAW_INPUTS]);

#ifdef __cplusplus
}
#endif

#endif /* LAW_H */
