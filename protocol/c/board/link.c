/* Replies, refusals, events, and the remembered reply.  SPEC.md HG-4.9, HG-9.6. */

#include "link.h"

void link_count(struct board *board, int reason)
{
    board->counters[reason]++;
}

/* --- What waits for the line ------------------------------------------------------------------ */

/* Return the place for the next bytes; `*room` is what the limit leaves. */
static uint8_t *place(struct board *board, size_t limit, size_t *room)
{
    if (board->output_first + limit > BOARD_OUTPUT) {
        memmove(board->output, board->output + board->output_first, board->output_length);
        board->output_first = 0;
    }
    *room = limit > board->output_length ? limit - board->output_length : 0;
    return board->output + board->output_first + board->output_length;
}

static void queue_wire(struct board *board, const uint8_t *wire, size_t length)
{
    size_t room;
    uint8_t *to = place(board, BOARD_OUTPUT, &room);

    if (length > room)
        return;
    memcpy(to, wire, length);
    board->output_length += length;
}

/* Build a frame where it leaves; return 0 if the limit leaves no room. */
static int queue_frame(struct board *board, const struct hg_header *header, const uint8_t *payload,
                       size_t length, size_t limit)
{
    size_t room;
    uint8_t *to = place(board, limit, &room);

    length = hg_build_frame(to, room, header, payload, length);
    board->output_length += length;
    return length != 0;
}

int64_t link_departure_us(const struct board *board)
{
    if (board->machine.departure_us == NULL)
        return board->now_us;
    return board->machine.departure_us(board->machine.context, board->output_length);
}

/* --- Responses -------------------------------------------------------------------------------- */

/* HG-4.10: a repetition does no harm, so these are neither compared nor remembered. */
int link_is_idempotent(uint8_t type)
{
    return type == HG_TYPE_MUTE || type == HG_TYPE_UPLOAD_CHUNK;
}

static struct hg_header response(const struct board *board, const struct request *request,
                                 uint8_t type, uint16_t session)
{
    struct hg_header header;

    memset(&header, 0, sizeof header);
    header.type = type;
    header.seq = request->header.seq;
    header.session = session;
    header.time_us = (uint32_t)link_departure_us(board);
    return header;
}

/* A response is built where it is remembered, whether or not the line has room for it. */
static void respond(struct board *board, const struct request *request, uint8_t type,
                    const uint8_t *payload, size_t length)
{
    struct link *link = &board->link;
    struct hg_header header = response(board, request, type, link->session);

    if (!request->in_session || link_is_idempotent(request->header.type)) {
        queue_frame(board, &header, payload, length, BOARD_OUTPUT);
        return;
    }
    link->answered = 1;
    link->answered_seq = request->header.seq;
    link->answered_crc = request->crc;
    link->answer_length = hg_build_frame(link->answer, BOARD_FRAME, &header, payload, length);
    link_repeat(board);
}

void link_reply(struct board *board, const struct request *request, const uint8_t *payload,
                size_t length)
{
    respond(board, request, (uint8_t)(request->header.type + HG_RESPONSE_OFFSET), payload, length);
}

static void write_error(uint8_t *payload, const struct request *request, uint8_t code,
                        uint32_t detail)
{
    struct hg_error value;

    value.request = request->header.type;
    value.code = code;
    value.detail = detail;
    hg_error_write(payload, &value);
}

void link_refuse(struct board *board, const struct request *request, uint8_t code, uint32_t detail)
{
    uint8_t payload[HG_SIZE_ERROR];

    write_error(payload, request, code, detail);
    respond(board, request, HG_TYPE_ERROR, payload, sizeof payload);
}

/* Refuse a request before it is compared with the last one; nothing is remembered (HG-4.9/4). */
void link_refuse_unseen(struct board *board, const struct request *request, uint8_t code,
                        uint32_t detail)
{
    uint8_t payload[HG_SIZE_ERROR];
    uint16_t session = code == HG_ERROR_STALE_SESSION ? 0 : board->link.session;
    struct hg_header header = response(board, request, HG_TYPE_ERROR, session);

    link_count(board, HG_COUNTER_REQUESTS);
    write_error(payload, request, code, detail);
    queue_frame(board, &header, payload, sizeof payload, BOARD_OUTPUT);
}

void link_greet(struct board *board, const struct request *request)
{
    struct hg_header header = response(board, request, HG_TYPE_HELLO_REPLY, board->link.session);

    queue_frame(board, &header, board->link.greeting, HG_SIZE_HELLO_REPLY, BOARD_OUTPUT);
}

void link_repeat(struct board *board)
{
    queue_wire(board, board->link.answer, board->link.answer_length);
}

/* --- Events ----------------------------------------------------------------------------------- */

int link_event(struct board *board, uint8_t type, const uint8_t *payload, size_t length,
               int64_t t_us, uint8_t flags, enum urgency urgency)
{
    static const size_t limits[] = {BOARD_OUTPUT / 2, BOARD_OUTPUT / 4 * 3, BOARD_OUTPUT};
    struct hg_header header;

    if (board->link.session == 0)
        return 0; /* HG-4.7 */
    memset(&header, 0, sizeof header);
    header.type = type;
    header.flags = flags;
    header.seq = board->link.event_seq;
    header.session = board->link.session;
    header.time_us = (uint32_t)t_us;
    if (!queue_frame(board, &header, payload, length, limits[urgency]))
        return 0;
    board->link.event_seq++; /* HG-9.5: an event that was not sent leaves no gap */
    return 1;
}
