/* Limits of a board, for the memory that it has.  The compiler sets any of them:
   -DBOARD_ELEMENTS=256 -DBOARD_QUEUE=16.  HELLO_REPLY advertises them as they are (HG-4.3). */

#ifndef BOARD_LIMITS_H
#define BOARD_LIMITS_H

#include "../haptogram_codec.h"

#ifndef BOARD_ELEMENTS /* transducers, at most */
#define BOARD_ELEMENTS HG_MAX_TRANSDUCERS
#endif
#ifndef BOARD_QUEUE /* stream frames that wait: 2 bytes for each element, and 32 */
#define BOARD_QUEUE 32
#endif
#ifndef BOARD_RING /* latches in the trace ring: 23 bytes each */
#define BOARD_RING 4096
#endif
#ifndef BOARD_MAX_POINTS /* focal points in one frame */
#define BOARD_MAX_POINTS 8
#endif
#ifndef BOARD_SEQUENCES /* stored sequences: 16 bytes each, without their frames */
#define BOARD_SEQUENCES 64
#endif
#ifndef BOARD_SEQUENCE_FRAMES
#define BOARD_SEQUENCE_FRAMES 65536
#endif
#ifndef BOARD_UPLOAD_BYTES /* bytes in one upload; the store may have less room */
#define BOARD_UPLOAD_BYTES (32u << 20)
#endif
#ifndef BOARD_UPLOAD_WINDOW
#define BOARD_UPLOAD_WINDOW 4
#endif
#ifndef BOARD_CHUNK_BYTES
#define BOARD_CHUNK_BYTES 2048
#endif
#ifndef BOARD_RX_WINDOW /* bytes that the port takes without a pause */
#define BOARD_RX_WINDOW 16384
#endif
#ifndef BOARD_LATCH_LEAD_US /* from the arrival of a stream frame to its latch (HG-5.8) */
#define BOARD_LATCH_LEAD_US 0
#endif
#ifndef BOARD_POINT_TIME_US /* what each focal point adds to that */
#define BOARD_POINT_TIME_US 0
#endif
#ifndef BOARD_OUTPUT /* bytes that may wait for the line */
#define BOARD_OUTPUT 16384
#endif

#define BOARD_BOOT_US 4284967296 /* HG-6.9: 2^32 - 10 s */
#define BOARD_NEVER INT64_MAX

#define BOARD_CARRIER_HZ 40000
#define BOARD_CARRIER_US 25
#define BOARD_HORIZON_US 10000000
#define BOARD_AHEAD_US 12000000 /* the longest hold with its ramp (HG-7.1), longer than the horizon */
#define BOARD_PLAYBACK_HZ 10000
#define BOARD_UNATTENDED_MS 600000
#define BOARD_RAMP_STEP_US 1000 /* HG-6.11/2 */

#define BOARD_FRAME HG_FRAME_BOUND(HG_MAX_BODY_BYTES)
/* Bytes that one frame leaves for the tail of a reply. */
#define BOARD_TAIL(fixed) (HG_MAX_BODY_BYTES - HG_HEADER_BYTES - (fixed))

HG_STATIC_ASSERT(BOARD_ELEMENTS >= 1 && BOARD_ELEMENTS <= HG_MAX_TRANSDUCERS, elements);
HG_STATIC_ASSERT(BOARD_QUEUE >= 4 && BOARD_QUEUE <= 0xFFFF, queue);
HG_STATIC_ASSERT(BOARD_RING >= 16 && BOARD_RING <= 0xFFFF, ring);
HG_STATIC_ASSERT(BOARD_MAX_POINTS >= 1 && BOARD_MAX_POINTS <= 250, max_points);
HG_STATIC_ASSERT(BOARD_UPLOAD_BYTES >= 16 && BOARD_UPLOAD_BYTES >= BOARD_ELEMENTS, upload);
HG_STATIC_ASSERT(BOARD_CHUNK_BYTES >= 64 && BOARD_CHUNK_BYTES <= 4000, chunk);
HG_STATIC_ASSERT(BOARD_RX_WINDOW >= 4098, rx_window);
HG_STATIC_ASSERT(BOARD_RX_WINDOW
                     >= BOARD_UPLOAD_WINDOW
                            * HG_FRAME_BOUND(HG_HEADER_BYTES + HG_SIZE_UPLOAD_CHUNK
                                             + BOARD_CHUNK_BYTES),
                 rx_window_holds_a_window_of_chunks);
HG_STATIC_ASSERT(BOARD_LATCH_LEAD_US <= 100000 && BOARD_POINT_TIME_US <= 100000, lead);
HG_STATIC_ASSERT(BOARD_OUTPUT >= 2 * BOARD_FRAME, output_holds_a_reply_beside_trace);

#endif
