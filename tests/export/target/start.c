/* Start of a program on the Cortex-M4F of the board MPS2 AN386; newlib writes by semihosting. */
#include <stdint.h>
#include <stdlib.h>

#define CPACR (*(volatile uint32_t *)0xE000ED88U)

extern uint32_t stack_top[];
extern uint32_t bss_begin[];
extern uint32_t bss_end[];

extern void initialise_monitor_handles(void);
extern int main(void);
void _init(void);
void _fini(void);
void reset(void);
static void fault(void);

struct table {
    uint32_t *stack;
    void (*handlers[6])(void);
};

__attribute__((section(".vectors"), used)) static const struct table vectors = {
    stack_top,
    /* then: not maskable, hard fault, memory, bus, usage */
    {reset, fault, fault, fault, fault, fault},
};

/* newlib's exit asks for them */
void _init(void) {}
void _fini(void) {}

__attribute__((noreturn)) void reset(void)
{
    uint32_t *word;

    CPACR |= 0xFU << 20; /* the floating-point unit, coprocessors 10 and 11 */
    __asm__ volatile("dsb\nisb" ::: "memory");
    for (word = bss_begin; word < bss_end; word++) {
        *word = 0U;
    }
    initialise_monitor_handles();
    exit(main());
}

/* Semihosting SYS_EXIT with ADP_Stopped_RunTimeErrorUnknown: the emulator ends with a failure. */
__attribute__((naked)) static void fault(void)
{
    __asm__ volatile("movs r0, #0x18\n"
                     "ldr r1, =0x20023\n"
                     "bkpt 0xAB\n"
                     "b .\n");
}
