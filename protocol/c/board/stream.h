/* Stream frames and their queue.  SPEC.md chapter 5. */

#ifndef BOARD_STREAM_H
#define BOARD_STREAM_H

#include "model.h"

void stream_submit(struct board *board, const struct hg_frame *frame, uint32_t index);
/* When a frame of so many focal points that comes now can be latched (HG-5.8). */
int64_t stream_ready_us(const struct board *board, size_t points);
/* The frame at the head of the queue; NULL: none waits. */
const struct entry *stream_next(const struct board *board);
void stream_latch(struct board *board);
void stream_flush(struct board *board);

#endif
