/* Counters, replies, events and the remembered reply.  SPEC.md chapters 3, 4 and 9. */

#ifndef BOARD_LINK_H
#define BOARD_LINK_H

#include "model.h"

enum urgency { TRACE, STATUS, OTHER }; /* HG-9.6: trace gives way first, then STATUS */

void link_count(struct board *board, int reason);
void link_reply(struct board *board, const struct request *request, const uint8_t *payload,
                size_t length);
void link_refuse(struct board *board, const struct request *request, uint8_t code, uint32_t detail);
void link_refuse_unseen(struct board *board, const struct request *request, uint8_t code,
                        uint32_t detail);
void link_greet(struct board *board, const struct request *request);
void link_repeat(struct board *board); /* the remembered reply once more */
int64_t link_departure_us(const struct board *board); /* when the next byte leaves */
int link_is_idempotent(uint8_t type);
int link_event(struct board *board, uint8_t type, const uint8_t *payload, size_t length,
               int64_t t_us, uint8_t flags, enum urgency urgency); /* 0: not sent */

#endif
