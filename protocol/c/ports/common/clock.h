/* Device time, unwrapped (HG-6.9), from the ticks of the chip.  For the main loop only: it has to
   ask at least once while the ticks run through their 32 bits. */

#ifndef PORT_CLOCK_H
#define PORT_CLOCK_H

#include <stdint.h>

int64_t clock_now_us(void);
int64_t clock_of_us(uint32_t ticks); /* of ticks that an interrupt read not long ago */
uint32_t clock_ticks_of(int64_t t_us); /* the ticks at a time that is not far */

#endif
