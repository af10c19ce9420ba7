/* Trace of latches, as events and in the ring.  SPEC.md HG-8.1 to HG-8.5. */

#ifndef BOARD_TRACE_H
#define BOARD_TRACE_H

#include "model.h"

uint32_t trace_drive_crc(const struct board *board, const struct drive *drive);
void trace_report(struct board *board, const struct latch *latch);
void trace_read(struct board *board, const struct request *request); /* READ_TRACE */

#endif
