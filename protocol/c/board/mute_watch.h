/* Finds MUTE among the bytes as they arrive, in the receive interrupt.  SPEC.md HG-6.4, HG-6.6.

   The output has to be off a carrier period after the closing delimiter of MUTE, whatever the main
   loop does then.  The watch is fed with the bytes that the parser gets later, and finds exactly the
   frames that the parser takes for MUTE; a byte costs it some ten instructions, a byte of MUTE forty.

   Shared state: the watch itself belongs to the interrupt alone.  Its finding is all that the main
   loop sees, and ports/common/line.h says how. */

#ifndef BOARD_MUTE_WATCH_H
#define BOARD_MUTE_WATCH_H

#include <stdint.h>

struct mute_watch {
    uint32_t crc;
    uint16_t encoded; /* bytes since the last delimiter */
    uint16_t decoded;
    uint8_t left;     /* bytes until the next code byte */
    uint8_t full;     /* 1: the block has no zero behind it */
    uint8_t is_other; /* 1: this run of bytes is no MUTE */
};

/* Take the next byte; return 1 if it closed a MUTE.  A watch of zeros is at its beginning. */
int mute_watch_take(struct mute_watch *watch, uint8_t byte);

#endif
