/* Configuration and correction in memory that outlives a reset.  SPEC.md HG-7.1/4. */

#ifndef BOARD_KEPT_H
#define BOARD_KEPT_H

#include "model.h"

void kept_take(struct board *board); /* at the start: those of before it, if they are whole */
void kept_give(struct board *board); /* if they have changed */

#endif
