/* The array, and its drive for focal points.  SPEC.md HG-5.4, HG-7.5. */

#ifndef BOARD_POINTS_H
#define BOARD_POINTS_H

#include "model.h"

void points_element(const struct board *board, size_t number, uint8_t *to);
void points_drive(const struct board *board, const uint8_t *points, size_t count,
                  struct drive *drive);

#endif
