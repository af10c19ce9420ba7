/* Uploads and stored sequences.  SPEC.md HG-7.2 to HG-7.4. */

#ifndef BOARD_UPLOADS_H
#define BOARD_UPLOADS_H

#include "model.h"

void upload_begin(struct board *board, const struct request *request);
void upload_chunk(struct board *board, const struct request *request);
void upload_commit(struct board *board, const struct request *request);
void upload_abandon(struct board *board);
struct sequence *upload_find(struct board *board, uint16_t id); /* 0: a free place */
/* The largest upload beside `taken_bytes` in the store. */
uint32_t upload_limit(const struct board *board, uint32_t taken_bytes);
const uint8_t *upload_frame(const struct board *board, const struct sequence *sequence,
                            uint32_t index);

#endif
