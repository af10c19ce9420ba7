/* The drive of the transducers, behind one gate for all of them.

   Board and gate: the board's main loop says what is radiated; the receive interrupt shuts the gate
   at once when MUTE arrives.  The gate is open only if the board radiates and no MUTE waits. */

#ifndef PORT_TRANSDUCERS_H
#define PORT_TRANSDUCERS_H

#include "../../board/model.h"

int64_t transducers_radiate(void *context, const struct drive *radiated, int64_t due_us);
void transducers_unmute(void); /* interrupts are off */

#endif
