/* The end of all output: queue, playback and timers.  SPEC.md HG-6.4, HG-12. */

#ifndef BOARD_SHUTDOWN_H
#define BOARD_SHUTDOWN_H

#include "model.h"

void shutdown_output(struct board *board);
void shutdown_by_timer(struct board *board);

#endif
