/* The next drive, handed to the machine before it is due.  SPEC.md HG-5.8. */

#ifndef BOARD_AHEAD_H
#define BOARD_AHEAD_H

#include "model.h"

/* Load the drive of the next latch, if the machine can and has not got it yet. */
void ahead_load(struct board *board);
const struct drive *ahead_playback_drive(struct board *board); /* of the frame that is due */

#endif
