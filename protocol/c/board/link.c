/* Sessions, sequence numbers and the remembered reply.  SPEC.md chapters 3 and 4. */

#include "board.h"

void link_count(struct board *board, int reason)
{
    board->counters[reason]++;
}

/* --- Out -------------------------------------------------------------------------------------- */

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

/* HG-4.10: doing these again does no harm, so they are neither compared nor remembered. */
static int is_idempotent(uint8_t type)
{
    return type == HG_TYPE_MUTE || type == HG_TYPE_UPLOAD_CHUNK;
}

static void answer(struct board *board, const struct request *request, const uint8_t *wire,
                   size_t length)
{
    struct link *link = &board->link;

    if (request->in_session && !is_idempotent(request->header.type)) {
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

/* Refused before the board has seen it: counted, and not remembered (HG-4.9/4). */
static void refuse_unseen(struct board *board, const struct request *request, int reason,
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
    board->link.event_seq++; /* HG-9.5: one that was not sent leaves no gap */
    return 1;
}

/* --- Sessions --------------------------------------------------------------------------------- */

static void greet(struct board *board, const struct request *request)
{
    uint8_t wire[BOARD_FRAME];
    uint8_t type = HG_TYPE_HELLO_REPLY;

    queue_wire(board, wire,
               response(board, wire, type, request, board->link.session, board->link.greeting,
                        HG_SIZE_HELLO_REPLY),
               BOARD_OUTPUT);
}

void link_open(struct board *board, uint16_t nonce, uint16_t seq)
{
    struct link *link = &board->link;

    link->session = nonce;
    link->stream_expected = HG_FIRST_STREAM_SEQ;
    link->control_newest = seq;
    link->event_seq = 0;
    link->answered = 0;
}

static void open_session(struct board *board, const struct request *request, uint16_t nonce)
{
    struct hg_hello_reply reply;
    struct hg_playback_ended ended;
    int played = playback_cut(board, &ended);

    output_enter(board, NEW_SESSION, HG_REASON_NEW_SESSION);
    output_silence(board);
    upload_abandon(board);
    board->has_latched = 0;
    board->latches = board->last_index = board->traced = 0;
    board->ring_count = board->ring_first = 0;
    memset(&board->latched, 0, sizeof board->latched);
    memset(&board->latest, 0, sizeof board->latest);
    link_open(board, nonce, request->header.seq);
    board_schedule_status(board);
    readout_identity(board, &reply);
    hg_hello_reply_write(board->link.greeting, &reply);
    greet(board, request);
    if (played)
        playback_tell(board, &ended); /* to the new host, behind its reply */
}

static void judge_hello(struct board *board, const struct request *request)
{
    struct hg_hello hello;

    hg_hello_read(&hello, request->payload);
    if (hello.major != HG_VERSION_MAJOR) {
        refuse_unseen(board, request, HG_COUNTER_UNSUPPORTED, HG_ERROR_VERSION, HG_VERSION_MAJOR);
    } else if (hello.nonce == 0) {
        refuse_unseen(board, request, HG_COUNTER_BAD_VALUE, HG_ERROR_BAD_VALUE,
                      HG_OFFSET_HELLO_NONCE);
    } else if (hello.nonce == board->link.session) {
        link_count(board, HG_COUNTER_REPEATED);
        greet(board, request);
    } else {
        link_count(board, HG_COUNTER_REQUESTS);
        open_session(board, request, hello.nonce);
    }
}

/* --- Checks (HG-3.8) -------------------------------------------------------------------------- */

static uint8_t unknown_flags(uint8_t type, uint8_t flags)
{
    int takes_immediate = type < 0x40 || type == HG_TYPE_PLAY;

    flags = (uint8_t)(flags & HG_MUST_UNDERSTAND);
    return takes_immediate ? (uint8_t)(flags & ~(unsigned)HG_FLAG_IMMEDIATE) : flags;
}

static void carry_out(struct board *board, const struct request *request)
{
    struct link *link = &board->link;

    link_count(board, HG_COUNTER_REQUESTS);
    if (request->in_session && hg_ahead_u16(request->header.seq, link->control_newest) > 0)
        link->control_newest = request->header.seq;
    request_carry_out(board, request);
}

/* Whether the number was used before; if so the request is answered here. */
static int is_repetition(struct board *board, const struct request *request)
{
    struct link *link = &board->link;
    uint16_t seq = request->header.seq;

    if (is_idempotent(request->header.type))
        return 0;
    if (link->answered && link->answered_seq == seq && link->answered_crc == request->crc) {
        link_count(board, HG_COUNTER_REPEATED);
        queue_wire(board, link->answer, link->answer_length, BOARD_OUTPUT);
        return 1;
    }
    if (hg_ahead_u16(seq, link->control_newest) > 0)
        return 0;
    refuse_unseen(board, request, HG_COUNTER_BAD_VALUE, HG_ERROR_SEQUENCE_REUSED, seq);
    return 1;
}

static void judge_payload(struct board *board, const struct request *request)
{
    uint8_t type = request->header.type;
    size_t fixed = 0, unit = 0, offset = 0;
    int reason = hg_check_message(type, request->payload, request->length, &offset);

    hg_message_layout(type, &fixed, &unit);
    if (reason == HG_COUNTER_BAD_LENGTH)
        refuse_unseen(board, request, reason, HG_ERROR_BAD_LENGTH,
                      unit != 0 ? 0 : (uint32_t)fixed);
    else if (reason == HG_COUNTER_BAD_VALUE)
        refuse_unseen(board, request, reason, HG_ERROR_BAD_VALUE, (uint32_t)offset);
    else if (type == HG_TYPE_HELLO)
        judge_hello(board, request);
    else if (!is_repetition(board, request))
        carry_out(board, request);
}

static void judge_request(struct board *board, const struct request *request)
{
    uint8_t type = request->header.type;
    uint8_t flags = unknown_flags(type, request->header.flags);
    size_t fixed, unit;

    if (type == HG_TYPE_MUTE)
        carry_out(board, request); /* HG-6.4: nothing refuses it */
    else if (!hg_message_layout(type, &fixed, &unit))
        refuse_unseen(board, request, HG_COUNTER_UNSUPPORTED, HG_ERROR_UNSUPPORTED, type);
    else if (type != HG_TYPE_HELLO && !request->in_session)
        refuse_unseen(board, request, HG_COUNTER_STALE_SESSION, HG_ERROR_STALE_SESSION,
                      board->link.session);
    else if (flags != 0)
        refuse_unseen(board, request, HG_COUNTER_UNSUPPORTED, HG_ERROR_UNSUPPORTED, flags);
    else
        judge_payload(board, request);
}

/* Set the unwrapped number; 0 if it is not newer than the last one (HG-5.5). */
static int take_index(struct board *board, uint16_t seq, uint32_t *index)
{
    struct link *link = &board->link;
    int32_t ahead = hg_ahead_u16(seq, (uint16_t)link->stream_expected);

    if (ahead < 0)
        return 0;
    board->counters[HG_COUNTER_GAP] += (uint32_t)ahead;
    *index = link->stream_expected + (uint32_t)ahead;
    link->stream_expected = *index + 1;
    return 1;
}

static void judge_stream(struct board *board, const struct hg_frame *frame, int in_session)
{
    uint8_t type = frame->header.type;
    size_t fixed, unit, offset;
    uint32_t index = 0;
    int fresh = in_session && take_index(board, frame->header.seq, &index); /* HG-5.6 */
    int reason;

    if (!hg_message_layout(type, &fixed, &unit)) {
        link_count(board, HG_COUNTER_UNKNOWN_TYPE);
    } else if (!in_session) {
        link_count(board, HG_COUNTER_STALE_SESSION);
    } else if (!fresh) {
        link_count(board, HG_COUNTER_DUPLICATE);
    } else if (unknown_flags(type, frame->header.flags) != 0) {
        link_count(board, HG_COUNTER_UNSUPPORTED);
    } else {
        reason = hg_check_message(type, frame->payload, frame->payload_length, &offset);
        if (reason != HG_OK)
            link_count(board, reason);
        else
            stream_submit(board, frame, index);
    }
}

void link_judge(struct board *board, const struct hg_frame *frame, int64_t t_us)
{
    uint16_t session = board->link.session;
    struct request request;

    link_count(board, HG_COUNTER_FRAMES);
    request.header = frame->header;
    request.payload = frame->payload;
    request.length = frame->payload_length;
    request.in_session = session != 0 && frame->header.session == session;
    request.t_rx_us = t_us;
    if (request.in_session)
        output_renew_lease(board); /* HG-6.7: whatever else becomes of the frame */
    if (frame->header.type < 0x40) {
        judge_stream(board, frame, request.in_session);
    } else if (frame->header.type < 0x80) {
        request.crc = hg_crc32(0, frame->body, frame->body_length);
        judge_request(board, &request);
    } else {
        link_count(board, HG_COUNTER_UNKNOWN_TYPE);
    }
}
