/* Arm Musca-B1: PL011 UART0, a dual timer as the clock, and the secure watchdog. */

#include "../common/chip.h"

#include "../common/cortex_m.h"
#include "../common/line.h"

#define UART_DR REGISTER(0x50105000u)
#define UART_FR REGISTER(0x50105018u)
#define UART_LCRH REGISTER(0x5010502Cu)
#define UART_CR REGISTER(0x50105030u)
#define UART_IMSC REGISTER(0x50105038u)
#define UART_ICR REGISTER(0x50105044u)
#define TIMER_LOAD REGISTER(0x50002000u)
#define TIMER_VALUE REGISTER(0x50002004u)
#define TIMER_CONTROL REGISTER(0x50002008u)
#define WATCHDOG_LOAD REGISTER(0x50081000u)
#define WATCHDOG_CONTROL REGISTER(0x50081008u)
#define WATCHDOG_INTCLR REGISTER(0x5008100Cu)
#define WATCHDOG_LOCK REGISTER(0x50081C00u)
#define GPIO_DATAOUT REGISTER(0x51000004u)
#define GPIO_OUTENSET REGISTER(0x51000010u)

enum {
    UART_IRQ = 44, /* all of its interrupts together */
    FR_RX_EMPTY = 0x10,
    FR_TX_FULL = 0x20,
    RECEIVE = 0x50, /* FIFO half full, or a byte for 32 bits of time */
    TRANSMIT = 0x20,
};

uint32_t chip_ticks(void) { return ~TIMER_VALUE; } /* it counts down */

void chip_enable_output(int enabled) { GPIO_DATAOUT = enabled ? 1 : 0; }

void chip_start(void)
{
    chip_enable_output(0);
    GPIO_OUTENSET = 1;
    TIMER_LOAD = 0xFFFFFFFFu;
    TIMER_CONTROL = 0x82; /* free running, 32 bits */
    UART_LCRH = 0x70;     /* 8 bits, FIFOs */
    UART_CR = 0x301;
    UART_IMSC = RECEIVE;
    enable_interrupt(UART_IRQ);
}

/* The bytes that the FIFO takes now; it asks for more by its interrupt. */
static void transmit(void)
{
    uint8_t byte;

    while ((UART_FR & FR_TX_FULL) == 0) {
        if (!line_next_byte(&byte)) {
            UART_IMSC = RECEIVE;
            return;
        }
        UART_DR = byte;
    }
    UART_IMSC = RECEIVE | TRANSMIT;
}

void chip_transmit(void)
{
    interrupts_off();
    transmit();
    interrupts_on();
}

static void uart_handler(void)
{
    UART_ICR = RECEIVE | TRANSMIT;
    while ((UART_FR & FR_RX_EMPTY) == 0)
        line_received((uint8_t)UART_DR, chip_ticks());
    if ((UART_IMSC & TRANSMIT) != 0)
        transmit();
}

void chip_watchdog_start(void)
{
    WATCHDOG_LOCK = 0x1ACCE551u;
    WATCHDOG_LOAD = CHIP_WATCHDOG_MS * CHIP_CORE_MHZ * 1000u;
    WATCHDOG_CONTROL = 3; /* NMI at the end of the load; reset at the end of the next, if need be */
}

void chip_watchdog_feed(void) { WATCHDOG_INTCLR = 1; }

const vector vectors[16 + 96] __attribute__((section(".vectors"), used)) = {
    CORE_VECTORS,
    [16 + UART_IRQ] = uart_handler,
};
