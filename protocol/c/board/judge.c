/* Sessions, and the checks of a frame.  SPEC.md HG-3.8 and chapter 4. */

#include "judge.h"

#include "link.h"
#include "output.h"
#include "playback.h"
#include "readout.h"
#include "requests.h"
#include "shutdown.h"
#include "stream.h"
#include "uploads.h"

/* --- Sessions --------------------------------------------------------------------------------- */

static void start_session(struct board *board, uint16_t nonce, uint16_t seq)
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
    int played = playback_clear(board, &ended);

    output_enter(board, NEW_SESSION, HG_REASON_NEW_SESSION);
    shutdown_output(board);
    upload_abandon(board);
    board->has_latched = 0;
    board->latches = board->last_index = board->traced = 0;
    board->ring_count = board->ring_first = 0;
    memset(&board->latched, 0, sizeof board->latched);
    memset(&board->latest, 0, sizeof board->latest);
    start_session(board, nonce, request->header.seq);
    readout_schedule_status(board);
    readout_identity(board, &reply);
    hg_hello_reply_write(board->link.greeting, &reply);
    link_greet(board, request);
    if (played)
        playback_send_ended(board, &ended); /* to the new host, behind its reply */
}

static void judge_hello(struct board *board, const struct request *request)
{
    struct hg_hello hello;

    hg_hello_read(&hello, request->payload);
    if (hello.major != HG_VERSION_MAJOR) {
        link_refuse_unseen(board, request, HG_ERROR_VERSION, HG_VERSION_MAJOR);
    } else if (hello.nonce == 0) {
        link_refuse_unseen(board, request, HG_ERROR_BAD_VALUE, HG_OFFSET_HELLO_NONCE);
    } else if (hello.nonce == board->link.session) {
        link_count(board, HG_COUNTER_REPEATED);
        link_greet(board, request);
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

static void take_number(struct board *board, const struct request *request)
{
    struct link *link = &board->link;

    link_count(board, HG_COUNTER_REQUESTS);
    if (request->in_session && hg_ahead_u16(request->header.seq, link->control_newest) > 0)
        link->control_newest = request->header.seq;
}

/* Return 1 if the number was used before; the request is answered here then. */
static int is_repetition(struct board *board, const struct request *request)
{
    struct link *link = &board->link;
    uint16_t seq = request->header.seq;

    if (link_is_idempotent(request->header.type))
        return 0;
    if (link->answered && link->answered_seq == seq && link->answered_crc == request->crc) {
        link_count(board, HG_COUNTER_REPEATED);
        link_repeat(board);
        return 1;
    }
    if (hg_ahead_u16(seq, link->control_newest) > 0)
        return 0;
    link_refuse_unseen(board, request, HG_ERROR_SEQUENCE_REUSED, seq);
    return 1;
}

static void judge_payload(struct board *board, const struct request *request)
{
    uint8_t type = request->header.type;
    size_t fixed = 0, unit = 0, offset = 0;
    int reason = hg_check_message(type, request->payload, request->length, &offset);

    hg_message_layout(type, &fixed, &unit);
    if (reason == HG_COUNTER_BAD_LENGTH) {
        link_refuse_unseen(board, request, HG_ERROR_BAD_LENGTH, unit != 0 ? 0 : (uint32_t)fixed);
    } else if (type == HG_TYPE_HELLO) {
        judge_hello(board, request);
    } else if (!is_repetition(board, request)) {
        take_number(board, request);
        if (reason == HG_COUNTER_BAD_VALUE)
            link_refuse(board, request, HG_ERROR_BAD_VALUE, (uint32_t)offset);
        else
            request_carry_out(board, request);
    }
}

static void judge_request(struct board *board, const struct request *request)
{
    uint8_t type = request->header.type;
    uint8_t flags = unknown_flags(type, request->header.flags);
    size_t fixed, unit;

    if (type == HG_TYPE_MUTE) {
        take_number(board, request);
        request_carry_out(board, request); /* HG-6.4: MUTE is never refused */
    } else if (!hg_message_layout(type, &fixed, &unit)) {
        link_refuse_unseen(board, request, HG_ERROR_UNSUPPORTED, type);
    } else if (type != HG_TYPE_HELLO && !request->in_session) {
        link_refuse_unseen(board, request, HG_ERROR_STALE_SESSION, board->link.session);
    } else if (flags != 0) {
        link_refuse_unseen(board, request, HG_ERROR_UNSUPPORTED, flags);
    } else {
        judge_payload(board, request);
    }
}

/* Set the unwrapped number; return 0 if the frame is a copy (HG-5.5). */
static int take_index(struct board *board, uint16_t seq, uint32_t *index)
{
    struct link *link = &board->link;
    uint32_t ahead = (seq - link->stream_expected) & 0xFFFF;

    if (ahead >= 0x10000 - 32)
        return 0;
    board->counters[HG_COUNTER_GAP] += ahead;
    *index = link->stream_expected + ahead;
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

void judge_frame(struct board *board, const struct hg_frame *frame, int64_t t_us)
{
    uint16_t session = board->link.session;
    struct request request;

    link_count(board, HG_COUNTER_FRAMES);
    request.header = frame->header;
    request.payload = frame->payload;
    request.length = frame->payload_length;
    request.in_session = session != 0 && frame->header.session == session
                         && frame->header.type != HG_TYPE_HELLO; /* which belongs to none */
    request.t_rx_us = t_us;
    if (request.in_session)
        output_renew_lease(board); /* HG-6.7: even if the frame is refused */
    if (frame->header.type < 0x40) {
        judge_stream(board, frame, request.in_session);
    } else if (frame->header.type < 0x80) {
        request.crc = hg_crc32(0, frame->body, frame->body_length);
        judge_request(board, &request);
    } else {
        link_count(board, HG_COUNTER_UNKNOWN_TYPE);
    }
}
