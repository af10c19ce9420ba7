/* Requests that passed every check of the link.  SPEC.md chapters 6 to 9. */

#ifndef BOARD_REQUESTS_H
#define BOARD_REQUESTS_H

#include "model.h"

void request_carry_out(struct board *board, const struct request *request);

#endif
