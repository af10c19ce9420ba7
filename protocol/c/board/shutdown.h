/* The end of all output: queue, playback and timers.  SPEC.md HG-6.4, HG-12. */

#ifndef BOARD_SHUTDOWN_H
#define BOARD_SHUTDOWN_H

#include "model.h"

void shutdown_output(struct board *board);
/* Carry MUTE out, its reply and events excepted: where it arrives, and again where its frame is. */
void shutdown_by_mute(struct board *board);
void shutdown_mute_answered(struct board *board, int in_session); /* the events behind the reply */
void shutdown_by_timer(struct board *board);

#endif
