/* The board side of the Haptogram wire protocol, without a line and without a clock.

   Time is an argument: unwrapped device microseconds.  Bytes go in with board_receive and come out
   of board_output.  board_advance does all that is due by itself, in order of time.  Nothing here
   allocates memory, waits or reads a clock.  reference_board.c gives the board a pseudo-terminal and
   the time of day, ports/ a microcontroller.

   None of these functions may be called in an interrupt while another runs: they share all of struct
   board.  What an interrupt may do with the bytes as they arrive is in mute_watch.h.

   The parts include each other one way only, from the top to the bottom of this list:
   board > judge, ahead, kept > requests > shutdown, readout > playback > stream, uploads > output > trace >
   link, points > model > limits. */

#ifndef BOARD_H
#define BOARD_H

#include "model.h"

void board_start(struct board *board, const struct array *array, const struct machine *machine);
/* Bytes whose last one arrived at `t_us`: cut behind each zero where the times are known. */
void board_receive(struct board *board, const uint8_t *data, size_t length, int64_t t_us);
/* A MUTE has arrived, the last of `bytes` that board_receive gets later: switch off now.  What is
   among them does not switch on again (HG-3.8/4), what comes behind them does.  To be called as often
   as one likes. */
void board_mute_ahead(struct board *board, size_t bytes);
void board_advance(struct board *board, int64_t t_us);
int64_t board_next_event(const struct board *board); /* BOARD_NEVER: nothing by itself */
const uint8_t *board_output(const struct board *board, size_t *length); /* bytes for the line */
void board_sent(struct board *board, size_t length); /* the line took so many of them */
void board_raise_hardware_fault(struct board *board);

#endif
