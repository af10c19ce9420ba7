/* STM32F405: USART1 on PA9 and PA10, output enable on PB0, clock of 168 MHz from a crystal.

   -DEMULATED: QEMU's netduinoplus2, which has no clock tree, no watchdog and a timer of 1 GHz.
   -DPORT_CRYSTAL_MHZ=, -DPORT_BAUD=: of the real board. */

#ifndef PORT_CHIP_CONFIG_H
#define PORT_CHIP_CONFIG_H

#ifndef PORT_CRYSTAL_MHZ
#define PORT_CRYSTAL_MHZ 8
#endif
#ifndef PORT_BAUD
#define PORT_BAUD 3000000
#endif

#define CHIP_CORE_MHZ 168
#define CHIP_TICKS_PER_US 1

#ifdef EMULATED
#define CHIP_TIMER_MHZ 1000
#define CHIP_LINE_BYTES_PER_S 0
#ifndef CHIP_MEASURES_LATCH
#define CHIP_MEASURES_LATCH 0
#endif
#define CHIP_WATCHDOG_MS 2000
#else
#define CHIP_TIMER_MHZ 84
#define CHIP_LINE_BYTES_PER_S (PORT_BAUD / 10)
#define CHIP_MEASURES_LATCH 1
#define CHIP_WATCHDOG_MS 100
#endif

#endif
