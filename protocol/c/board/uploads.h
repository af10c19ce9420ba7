/* Uploads and stored sequences.  SPEC.md HG-7.2 to HG-7.4. */

#ifndef BOARD_UPLOADS_H
#define BOARD_UPLOADS_H

#include "model.h"

void upload_begin(struct board *board, const struct request *request);
void upload_chunk(struct board *board, const struct request *request);
void upload_commit(struct board *board, const struct request *request);
void upload_abandon(struct board *board);
struct sequence *upload_find(struct board *board, uint16_t id); /* 0: a free place */
uint32_t upload_stored(const struct board *board);              /* bytes of all sequences */

#endif
