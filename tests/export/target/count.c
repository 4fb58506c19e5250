/* Executed instructions of an update, for INPUTS random inputs.
 *
 * The emulator's clock goes on by 1 ns an instruction (-icount shift=0), SysTick by one tick in
 * 40 ns. What calls of a function of one instruction (the return) take is taken off, so that
 * what is left is the update from its first instruction to its return. Stack is measured by what
 * an update leaves of a pattern below the stack pointer; nothing interrupts it.
 */
#include "draw.h"

#include <stdio.h>

#define CONTROL (*(volatile uint32_t *)0xE000E010U)
#define RELOAD (*(volatile uint32_t *)0xE000E014U)
#define CURRENT (*(volatile uint32_t *)0xE000E018U)
#define MASK 0xFFFFFFU
#define NANOSECONDS 40.0
#define REPEATS 400U
#define PATTERN 0xA5C35A3CU
#define WORDS 4096U

typedef uint32_t (*function)(TYPES);

/* One instruction; and, for the check of the clock, a loop of two. */
uint32_t nothing(TYPES);
void twice(uint32_t repeats);
__asm__(".thumb\n"
        ".syntax unified\n"
        ".thumb_func\n"
        "nothing: bx lr\n"
        ".thumb_func\n"
        "twice: subs r0, r0, #1\n"
        "bne twice\n"
        "bx lr\n");

static __attribute__((noinline)) uint32_t ticks(
    function called, const struct inputs *in, uint32_t repeats)
{
    law_real u[LAW_INPUTS];
    const uint32_t begin = CURRENT;
    uint32_t k;

    for (k = 0U; k < repeats; k++) {
        (void)called(VALUES(*in, u));
    }
    return (begin - CURRENT) & MASK;
}

static __attribute__((noinline)) uint32_t stack(const struct inputs *in)
{
    law_real u[LAW_INPUTS];
    volatile uint32_t *top;
    uint32_t k;

    __asm__ volatile("mov %0, sp" : "=r"(top));
    top -= WORDS;
    for (k = 0U; k < WORDS; k++) {
        top[k] = PATTERN;
    }
    (void)law_update(VALUES(*in, u));
    for (k = 0U; (k < WORDS) && (top[k] == PATTERN); k++) {
        /* not reached */
    }
    return 4U * (WORDS - k);
}

static double each(uint32_t more, uint32_t less, uint32_t repeats)
{
    return NANOSECONDS * ((double)more - (double)less) / (double)repeats;
}

int main(void)
{
    uint32_t begin;
    uint32_t k;

    RELOAD = MASK;
    CURRENT = 0U;
    CONTROL = 5U; /* the processor's clock, no interrupt */
    begin = CURRENT;
    twice(100000U);
    printf("loop %.3f\n", each((begin - CURRENT) & MASK, 0U, 100000U));
    for (k = 0U; k < INPUTS; k++) {
        struct inputs next;
        uint32_t law;
        uint32_t none;

        draw(&next);
        law = ticks(law_update, &next, REPEATS);
        none = ticks(nothing, &next, REPEATS);
        printf("update %.3f\n", 1.0 + each(law, none, REPEATS));
        printf("stack %u\n", (unsigned)stack(&next));
    }
    return 0;
}
