/* From reset to main: memory, stack, unit of floating point; and what faults do. */

#include "chip.h"
#include "cortex_m.h"
#include "transducers.h"

extern uint32_t data_start[], data_end[], data_image[], bss_start[], bss_end[], stack_bottom[];
extern const vector vectors[];

int main(void);

#define UNUSED_STACK 0xC5C5C5C5u /* how much is left of it shows how deep the stack was */

static void enable_floating_point(void)
{
#ifdef __ARM_FP
    SCB_CPACR |= 0xFu << 20;
    __asm volatile("dsb\n\tisb" ::: "memory");
#endif
}

static uint32_t *stack_pointer(void)
{
    uint32_t *pointer;

    __asm volatile("mov %0, sp" : "=r"(pointer));
    return pointer;
}

void reset_handler(void)
{
    uint32_t *to, *from = data_image;

    enable_floating_point();
    for (to = stack_bottom; to < stack_pointer() - 16; to++)
        *to = UNUSED_STACK;
    for (to = data_start; to < data_end; to++)
        *to = *from++;
    for (to = bss_start; to < bss_end; to++)
        *to = 0;
    SCB_VTOR = (uint32_t)(uintptr_t)vectors;
    main();
    fault_handler();
}

/* Nothing is known of what went wrong, so nothing goes on: off, and from the beginning. */
void fault_handler(void)
{
    chip_enable_output(0);
    reset_chip();
}

/* SysTick has fired: for a drive that is loaded, or to wake the main loop. */
void wake_handler(void)
{
    SYST_CSR = 0;
    transducers_tick();
}
