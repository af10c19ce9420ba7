/* The drive of the transducers, behind one gate for all of them.

   Main loop and timer interrupt: the main loop loads the next drive ahead, into registers that do
   not drive yet, and the interrupt makes them drive when they are due, whatever the loop computes
   then.  The main loop changes what is loaded, and due, with nothing waiting.

   Board and gate: the board's main loop says what is radiated; the receive interrupt shuts the gate
   at once when MUTE arrives.  The gate is open only if the board radiates and no MUTE waits. */

#ifndef PORT_TRANSDUCERS_H
#define PORT_TRANSDUCERS_H

#include "../../board/model.h"

void transducers_load(void *context, const struct drive *radiated, int64_t due_us);
int64_t transducers_radiate(void *context, const struct drive *radiated, int64_t due_us);
int64_t transducers_strobe_us(void); /* when transducers_tick is due; BOARD_NEVER: not at all */
/* Take the drive that is due, or set the alarm for it; in its interrupt, or with interrupts off. */
void transducers_tick(void);
void transducers_shut(void);         /* in the interrupt that finds MUTE */
void transducers_unmute(void);       /* interrupts are off */

#endif
