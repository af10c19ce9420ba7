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

void shutdown_by_mute(struct board *board)
{
    struct muting *muting = &board->muting;
    uint8_t before = board->state;

    output_enter(board, MUTE, HG_REASON_MUTE);
    muting->changed |= board->state != before;
    muting->played |= playback_clear(board, &muting->ended);
    stream_flush(board);
    output_off(board);
}

void shutdown_mute_answered(struct board *board, int in_session)
{
    struct muting *muting = &board->muting;

    if (!in_session && muting->changed)
        output_send_state(board); /* HG-6.8/2: MUTE of another session */
    if (muting->played)
        playback_send_ended(board, &muting->ended);
    muting->changed = muting->played = 0;
}

void shutdown_by_timer(struct board *board)
{
    board->counters[HG_COUNTER_TIMEOUTS]++;
    output_enter(board, RAMP_ENDED, output_end_reason(board));
    output_send_state(board);
    shutdown_output(board);
}
