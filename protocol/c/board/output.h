/* Output state, timers and latch.  SPEC.md chapters 5, 6 and 12. */

#ifndef BOARD_OUTPUT_H
#define BOARD_OUTPUT_H

#include "model.h"

enum output_input { NEW_SESSION, ARM, MUTE, DISARM, RAMP_ENDED, FAULT_FOUND, OUTPUT_INPUTS };

int output_enter(struct board *board, enum output_input input, uint8_t reason); /* 0: refused */
void output_send_state(struct board *board); /* STATE_CHANGED */
void output_renew_lease(struct board *board);
void output_reconfigure(struct board *board);
int64_t output_ramp_us(const struct board *board); /* when a ramp is to begin */
void output_begin_ramp(struct board *board);
int64_t output_end_us(const struct board *board); /* of the ramp */
uint8_t output_end_reason(const struct board *board);
int64_t output_boundary_us(const struct board *board, int64_t t_us);
void output_latch(struct board *board, const struct hg_latch_key *key, const struct drive *drive,
                  int late);
void output_off(struct board *board);
int64_t output_step_us(const struct board *board); /* BOARD_NEVER: the output does not change */
void output_step(struct board *board);
void output_radiated(const struct board *board, struct drive *drive);
/* What a latched drive leads to at full output: below the ceiling, and corrected. */
void output_shape(const struct board *board, const struct drive *latched, struct drive *radiated);

#endif
