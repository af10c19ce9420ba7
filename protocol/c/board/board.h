/* The board side of the Haptogram wire protocol, without a line and without a clock.

   Time is an argument: unwrapped device microseconds.  Bytes go in with board_receive, bytes come
   out of `output`.  board_advance does all that is due by itself, in order of time.
   reference_board.c gives the board a pseudo-terminal and the time of day.

   The parts include each other one way only, from the top to the bottom of this list:
   board > judge > requests > shutdown, readout > playback > stream, uploads > output > trace >
   link, points > model. */

#ifndef BOARD_H
#define BOARD_H

#include "model.h"

void board_start(struct board *board, const struct array *array);
void board_stop(struct board *board); /* gives the memory of sequences back */
void board_receive(struct board *board, const uint8_t *data, size_t length, int64_t t_us);
void board_advance(struct board *board, int64_t t_us);
int64_t board_next_event(const struct board *board); /* BOARD_NEVER: nothing by itself */
void board_sent(struct board *board, size_t length); /* the line took so much of the output */
void board_raise_hardware_fault(struct board *board);

#endif
