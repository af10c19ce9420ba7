/* Sequences on the board's clock.  SPEC.md HG-7.6 to HG-7.8. */

#ifndef BOARD_PLAYBACK_H
#define BOARD_PLAYBACK_H

#include "model.h"

void playback_play(struct board *board, const struct request *request);
void playback_stop(struct board *board);
void playback_end(struct board *board); /* and PLAYBACK_ENDED, if something played */
int playback_clear(struct board *board, struct hg_playback_ended *ended);
void playback_send_ended(struct board *board, const struct hg_playback_ended *ended);
void playback_next(const struct board *board, struct hg_latch_key *key); /* what plays now */
void playback_drive(const struct board *board, struct drive *drive);       /* of that frame */
void playback_latch(struct board *board, const struct drive *drive);
int64_t playback_due_us(const struct board *board); /* BOARD_NEVER: nothing plays */

#endif
