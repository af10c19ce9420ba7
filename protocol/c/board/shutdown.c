/* The end of all output: queue, playback and timers.  SPEC.md HG-6.4, HG-12. */

#include "shutdown.h"

#include "output.h"
#include "playback.h"
#include "stream.h"

void shutdown_output(struct board *board)
{
    stream_flush(board);
    playback_end(board);
    output_off(board);
}

void shutdown_by_timer(struct board *board)
{
    board->counters[HG_COUNTER_TIMEOUTS]++;
    output_enter(board, RAMP_ENDED, output_end_reason(board));
    output_send_state(board);
    shutdown_output(board);
}
