/* Identity, status, geometry and drive.  SPEC.md HG-4.3, HG-7.5, HG-8.6 and chapter 9. */

#ifndef BOARD_READOUT_H
#define BOARD_READOUT_H

#include "model.h"

void readout_identity(const struct board *board, struct hg_hello_reply *reply);
void readout_status(struct board *board, uint8_t *payload); /* HG_SIZE_STATUS bytes */
uint32_t readout_least_status_ms(const struct board *board); /* HG-7.1/2 */
void readout_schedule_status(struct board *board);
void readout_send_status(struct board *board);
void readout_geometry(struct board *board, const struct request *request);
void readout_drive(struct board *board, const struct request *request);
uint32_t readout_config_crc(const struct board *board);

#endif
