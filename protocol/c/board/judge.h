/* The checks of a frame, in the order of SPEC.md HG-3.8, and the session. */

#ifndef BOARD_JUDGE_H
#define BOARD_JUDGE_H

#include "model.h"

void judge_frame(struct board *board, const struct hg_frame *frame, int64_t t_us);

#endif
