/* Replies, refusals, events, and the remembered reply.  SPEC.md HG-4.9, HG-9.6. */

#include "link.h"

void link_count(struct board *board, int reason)
{
    board->counters[reason]++;
}

static int queue_wire(struct board *board, const uint8_t *wire, size_t length, size_t limit)
{
    if (length == 0 || board->output_length + length > limit)
        return 0;
    memcpy(board->output + board->output_length, wire, length);
    board->output_length += length;
    return 1;
}

static size_t response(const struct board *board, uint8_t *wire, uint8_t type,
                       const struct request *request, uint16_t session, const uint8_t *payload,
                       size_t length)
{
    struct hg_header header;

    memset(&header, 0, sizeof header);
    header.type = type;
    header.seq = request->header.seq;
    header.session = session;
    header.time_us = (uint32_t)board->now_us;
    return hg_build_frame(wire, BOARD_FRAME, &header, payload, length);
}

static size_t error(const struct board *board, uint8_t *wire, const struct request *request,
                    uint8_t code, uint32_t detail)
{
    uint8_t payload[HG_SIZE_ERROR];
    struct hg_error value;
    uint16_t session = code == HG_ERROR_STALE_SESSION ? 0 : board->link.session;

    value.request = request->header.type;
    value.code = code;
    value.detail = detail;
    hg_error_write(payload, &value);
    return response(board, wire, HG_TYPE_ERROR, request, session, payload, sizeof payload);
}

/* HG-4.10: a repetition does no harm, so these are neither compared nor remembered. */
int link_is_idempotent(uint8_t type)
{
    return type == HG_TYPE_MUTE || type == HG_TYPE_UPLOAD_CHUNK;
}

static void answer(struct board *board, const struct request *request, const uint8_t *wire,
                   size_t length)
{
    struct link *link = &board->link;

    if (request->in_session && !link_is_idempotent(request->header.type)) {
        link->answered = 1;
        link->answered_seq = request->header.seq;
        link->answered_crc = request->crc;
        link->answer_length = length;
        memcpy(link->answer, wire, length);
    }
    queue_wire(board, wire, length, BOARD_OUTPUT);
}

void link_reply(struct board *board, const struct request *request, const uint8_t *payload,
                size_t length)
{
    uint8_t wire[BOARD_FRAME];
    uint8_t type = (uint8_t)(request->header.type + HG_RESPONSE_OFFSET);

    answer(board, request, wire,
           response(board, wire, type, request, board->link.session, payload, length));
}

void link_refuse(struct board *board, const struct request *request, uint8_t code, uint32_t detail)
{
    uint8_t wire[BOARD_FRAME];

    answer(board, request, wire, error(board, wire, request, code, detail));
}

/* Refuse a request that failed a check: it is counted, and not remembered (HG-4.9/4). */
void link_refuse_unseen(struct board *board, const struct request *request, int reason,
                        uint8_t code, uint32_t detail)
{
    uint8_t wire[BOARD_FRAME];

    link_count(board, reason);
    queue_wire(board, wire, error(board, wire, request, code, detail), BOARD_OUTPUT);
}

int link_event(struct board *board, uint8_t type, const uint8_t *payload, size_t length,
               int64_t t_us, uint8_t flags, enum urgency urgency)
{
    static const size_t limits[] = {BOARD_OUTPUT / 2, BOARD_OUTPUT / 4 * 3, BOARD_OUTPUT};
    uint8_t wire[BOARD_FRAME];
    struct hg_header header;

    if (board->link.session == 0)
        return 0; /* HG-4.7 */
    memset(&header, 0, sizeof header);
    header.type = type;
    header.flags = flags;
    header.seq = board->link.event_seq;
    header.session = board->link.session;
    header.time_us = (uint32_t)t_us;
    length = hg_build_frame(wire, BOARD_FRAME, &header, payload, length);
    if (!queue_wire(board, wire, length, limits[urgency]))
        return 0;
    board->link.event_seq++; /* HG-9.5: an event that was not sent leaves no gap */
    return 1;
}

void link_greet(struct board *board, const struct request *request)
{
    uint8_t wire[BOARD_FRAME];
    uint8_t type = HG_TYPE_HELLO_REPLY;

    queue_wire(board, wire,
               response(board, wire, type, request, board->link.session, board->link.greeting,
                        HG_SIZE_HELLO_REPLY),
               BOARD_OUTPUT);
}

void link_repeat(struct board *board)
{
    queue_wire(board, board->link.answer, board->link.answer_length, BOARD_OUTPUT);
}
