/* STM32F405, by its reference manual RM0090. */

#include "../common/chip.h"

#include "../common/cortex_m.h"
#include "../common/line.h"

#define RCC_CR REGISTER(0x40023800u)
#define RCC_PLLCFGR REGISTER(0x40023804u)
#define RCC_CFGR REGISTER(0x40023808u)
#define RCC_AHB1ENR REGISTER(0x40023830u)
#define RCC_APB1ENR REGISTER(0x40023840u)
#define RCC_APB2ENR REGISTER(0x40023844u)
#define FLASH_ACR REGISTER(0x40023C00u)
#define GPIOA_MODER REGISTER(0x40020000u)
#define GPIOA_OSPEEDR REGISTER(0x40020008u)
#define GPIOA_AFRH REGISTER(0x40020024u)
#define GPIOB_MODER REGISTER(0x40020400u)
#define GPIOB_BSRR REGISTER(0x40020418u)
#define TIM2_CR1 REGISTER(0x40000000u)
#define TIM2_EGR REGISTER(0x40000014u)
#define TIM2_CNT REGISTER(0x40000024u)
#define TIM2_PSC REGISTER(0x40000028u)
#define TIM2_ARR REGISTER(0x4000002Cu)
#define USART1_SR REGISTER(0x40011000u)
#define USART1_DR REGISTER(0x40011004u)
#define USART1_BRR REGISTER(0x40011008u)
#define USART1_CR1 REGISTER(0x4001100Cu)
#define IWDG_KR REGISTER(0x40003000u)
#define IWDG_PR REGISTER(0x40003004u)
#define IWDG_RLR REGISTER(0x40003008u)

enum {
    USART1_IRQ = 37,
    SR_RXNE_OR_OVERRUN = 0x28,
    SR_TXE = 0x80,
    CR1_TXEIE = 0x80,
    CR1_ON = 0x202C, /* USART, receiver with its interrupt, transmitter */
};

/* --- Clock --------------------------------------------------------------------------------------- */

#ifndef EMULATED
/* 168 MHz from the crystal; APB1 at a quarter, APB2 at half of it, their timers at twice that.
   Without a crystal nothing starts: the clock would be worse than the board says. */
static void start_clock(void)
{
    const uint32_t hse_on = 1u << 16, hse_ready = 1u << 17, pll_on = 1u << 24, pll_ready = 1u << 25;

    RCC_CR |= hse_on;
    while ((RCC_CR & hse_ready) == 0)
        ;
    RCC_PLLCFGR = PORT_CRYSTAL_MHZ | 336u << 6 | 0u << 16 | 1u << 22 | 7u << 24;
    RCC_CR |= pll_on;
    FLASH_ACR = 0x705; /* 5 wait states, caches and prefetch */
    RCC_CFGR = 5u << 10 | 4u << 13;
    while ((RCC_CR & pll_ready) == 0)
        ;
    RCC_CFGR |= 2;
    while ((RCC_CFGR >> 2 & 3) != 2)
        ;
}
#else
static void start_clock(void) {}
#endif

static void start_timer(void)
{
    TIM2_PSC = CHIP_TIMER_MHZ - 1;
    TIM2_ARR = 0xFFFFFFFFu;
    TIM2_EGR = 1; /* takes the prescaler */
    TIM2_CR1 = 1;
}

uint32_t chip_ticks(void) { return TIM2_CNT; }

/* --- Pins and line ------------------------------------------------------------------------------- */

void chip_enable_output(int enabled) { GPIOB_BSRR = enabled ? 1u : 1u << 16; }

static void start_pins(void)
{
    chip_enable_output(0);
    GPIOB_MODER = (GPIOB_MODER & ~3u) | 1u;                     /* PB0: output */
    GPIOA_AFRH = (GPIOA_AFRH & ~0xFF0u) | 0x770u;               /* PA9, PA10: USART1 */
    GPIOA_OSPEEDR |= 0xFu << 18;
    GPIOA_MODER = (GPIOA_MODER & ~(0xFu << 18)) | 0xAu << 18;
}

void chip_start(void)
{
    start_clock();
    RCC_AHB1ENR |= 3u;       /* GPIOA, GPIOB */
    RCC_APB1ENR |= 1u;       /* TIM2 */
    RCC_APB2ENR |= 1u << 4;  /* USART1 */
    start_pins();
    start_timer();
    USART1_BRR = (84000000u + PORT_BAUD / 2) / PORT_BAUD;
    USART1_CR1 = CR1_ON;
    enable_interrupt(USART1_IRQ);
}

/* The bytes that the transmitter takes now; it asks for more by its interrupt. */
static void transmit(void)
{
    uint8_t byte;

    while ((USART1_SR & SR_TXE) != 0) {
        if (!line_next_byte(&byte)) {
            USART1_CR1 = CR1_ON;
            return;
        }
        USART1_DR = byte;
    }
    USART1_CR1 = CR1_ON | CR1_TXEIE;
}

void chip_transmit(void)
{
    interrupts_off();
    transmit();
    interrupts_on();
}

static void usart_handler(void)
{
    while ((USART1_SR & SR_RXNE_OR_OVERRUN) != 0)
        line_received((uint8_t)USART1_DR, chip_ticks());
    if ((USART1_CR1 & CR1_TXEIE) != 0)
        transmit();
}

/* --- Watchdog ------------------------------------------------------------------------------------ */

/* Runs on an oscillator of its own, about 32 kHz, and cannot be stopped again. */
void chip_watchdog_start(void)
{
    IWDG_KR = 0x5555;
    IWDG_PR = 3; /* a 32nd: 1 kHz */
    IWDG_RLR = CHIP_WATCHDOG_MS;
    IWDG_KR = 0xCCCC;
}

void chip_watchdog_feed(void) { IWDG_KR = 0xAAAA; }

const vector vectors[16 + 82] __attribute__((section(".vectors"), used)) = {
    CORE_VECTORS,
    [16 + USART1_IRQ] = usart_handler,
};
