/* What every Cortex-M has: interrupts, SysTick, reset.  ARMv6-M and up. */

#ifndef PORT_CORTEX_M_H
#define PORT_CORTEX_M_H

#include <stdint.h>

#include "chip_config.h"

#define REGISTER(address) (*(volatile uint32_t *)(uintptr_t)(address))

#define SYST_CSR REGISTER(0xE000E010u)
#define SYST_RVR REGISTER(0xE000E014u)
#define SYST_CVR REGISTER(0xE000E018u)
#define NVIC_ISER(irq) REGISTER(0xE000E100u + 4u * ((irq) / 32u))
#define SCB_VTOR REGISTER(0xE000ED08u)
#define SCB_AIRCR REGISTER(0xE000ED0Cu)
#define SCB_SHPR3 REGISTER(0xE000ED20u)
#define SCB_CPACR REGISTER(0xE000ED88u)

static inline void interrupts_off(void) { __asm volatile("cpsid i" ::: "memory"); }
static inline void interrupts_on(void) { __asm volatile("cpsie i" ::: "memory"); }
/* Wakes up for an interrupt even while interrupts are off. */
static inline void wait_for_interrupt(void) { __asm volatile("dsb\n\twfi" ::: "memory"); }
static inline void enable_interrupt(unsigned irq) { NVIC_ISER(irq) = 1u << irq % 32u; }

/* Let SysTick fire once, so much later or as late as its 24 bits allow. */
static inline void set_alarm(uint32_t after_us)
{
    const uint32_t most_us = 0xFFFFFFu / CHIP_CORE_MHZ;

    SYST_CSR = 0;
    SYST_RVR = (after_us < most_us ? after_us : most_us) * CHIP_CORE_MHZ - 1;
    SYST_CVR = 0;
    SYST_CSR = 7; /* clock of the core, interrupt, on */
}

static inline void reset_chip(void)
{
    __asm volatile("dsb" ::: "memory");
    SCB_AIRCR = 0x05FA0004u;
    for (;;)
        ;
}

typedef void (*vector)(void);

/* common/startup.c */
void reset_handler(void);
void fault_handler(void);
void wake_handler(void); /* SysTick */
extern uint32_t stack_top[];

/* The first 16 vectors of a chip; an NMI is a watchdog or a failed clock: a fault too. */
#define CORE_VECTORS                                                                               \
    [0] = (vector)(uintptr_t)stack_top, [1] = reset_handler, [2] = fault_handler,                  \
    [3] = fault_handler, [4] = fault_handler, [5] = fault_handler, [6] = fault_handler,            \
    [7] = fault_handler, [11] = fault_handler, [14] = fault_handler, [15] = wake_handler

#endif
