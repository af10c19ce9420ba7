/* What a chip gives the board: a line, a clock, a pin and a watchdog.  chip.c of each port.

   chip_config.h of the port has its numbers:
   CHIP_CORE_MHZ         clock of the core and of SysTick
   CHIP_TICKS_PER_US     rate of chip_ticks
   CHIP_LINE_BYTES_PER_S a tenth of the baud rate; 0 where the line has none, as in an emulator
   CHIP_MEASURES_LATCH   1: the time of a latch is read from the clock when the drive was loaded; 0:
                         the time that was due, as in an emulator, whose host wakes it up at any time
   CHIP_WATCHDOG_MS      how long the main loop may hang before the chip is reset */

#ifndef PORT_CHIP_H
#define PORT_CHIP_H

#include <stdint.h>

#include "chip_config.h"

void chip_start(void);                /* clocks, pins, line, timer; interrupts are off */
uint32_t chip_ticks(void);            /* free running, all 32 bits */
void chip_enable_output(int enabled); /* the pin that gates all transducers; one write, any context */
void chip_transmit(void);             /* begin to send what line_next_byte gives */
void chip_watchdog_start(void);
void chip_watchdog_feed(void);

#endif
