/* What the transducers get, told to an emulator: -DPORT_TRACES_PINS=1, and `emulate --pins FILE`.

   A record for every change of the gate or of the registers that drive, in the file that the command
   line of the semihosting names: u32 ticks of the chip (as CHIP_MEASURES_LATCH says, those at which a
   latch was due), u16 ticks per microsecond, u16 1 if the gate is open, a phase for each element, an
   amplitude for each.  Another one after 10 s without a change, as ticks wrap.  A real chip stops at
   the first one, as it has no emulator around it. */

#ifndef PORT_PIN_TRACE_H
#define PORT_PIN_TRACE_H

#include "../../board/model.h"

#ifndef PORT_TRACES_PINS
#define PORT_TRACES_PINS 0
#endif
#ifndef PIN_TRACE_LONGEST_S
#define PIN_TRACE_LONGEST_S 10
#endif

/* Interrupts are off, or this is one. */
void pin_trace(int is_open, uint32_t ticks, const volatile struct drive *driving);
void pin_trace_again(void); /* once a turn of the main loop: what did not change for 10 s */

#endif
