/* Trace of latches, as events and in the ring.  SPEC.md HG-8.1 to HG-8.5. */

#include "trace.h"

#include "link.h"

uint32_t trace_drive_crc(const struct board *board, const struct drive *drive)
{
    uint32_t crc = hg_crc32(0, drive->phase, board->count);

    return hg_crc32(crc, drive->amplitude, board->count);
}

static void write_record(uint8_t *to, const struct latch *latch)
{
    struct hg_trace_record record;

    record.number = latch->number;
    record.key = latch->key;
    record.t_latch_us = (uint32_t)latch->t_us;
    record.crc = latch->crc;
    record.flags = latch->late ? HG_FLAG_LATE : 0;
    hg_trace_record_write(to, &record);
}

static void remember(struct board *board, const struct latch *latch)
{
    write_record(board->ring[(board->ring_first + board->ring_count) % BOARD_RING], latch);
    if (board->ring_count < BOARD_RING)
        board->ring_count++;
    else
        board->ring_first = (board->ring_first + 1) % BOARD_RING;
}

/* Return the number of a latch in the ring, 0 being the oldest. */
static uint32_t number_at(const struct board *board, size_t place)
{
    return hg_get_u32(board->ring[(board->ring_first + place) % BOARD_RING]);
}

static void send_trace(struct board *board, uint8_t type, const struct latch *latch,
                       const uint8_t *payload, size_t length)
{
    uint8_t flags = latch->late ? HG_FLAG_LATE : 0;

    if (!link_event(board, type, payload, length, latch->t_us, flags, TRACE))
        board->counters[HG_COUNTER_TRACE_DROPPED]++;
}

static void report_drive(struct board *board, const struct latch *latch)
{
    uint8_t *payload = board->scratch;
    size_t count = board->count;
    struct hg_trace_drive trace;

    if (board->traced++ % board->config.trace_divider != 0)
        return;
    trace.key = latch->key;
    hg_trace_drive_write(payload, &trace);
    memcpy(payload + HG_SIZE_TRACE_DRIVE, board->latched.phase, count);
    memcpy(payload + HG_SIZE_TRACE_DRIVE + count, board->latched.amplitude, count);
    send_trace(board, HG_TYPE_TRACE_DRIVE, latch, payload, HG_SIZE_TRACE_DRIVE + 2 * count);
}

static void report_crc(struct board *board, const struct latch *latch)
{
    uint8_t payload[HG_SIZE_TRACE_PLAYBACK];
    struct hg_trace_playback playback;
    struct hg_trace trace;

    if (latch->key.sequence != 0) {
        playback.key = latch->key;
        playback.crc = latch->crc;
        hg_trace_playback_write(payload, &playback);
        send_trace(board, HG_TYPE_TRACE_PLAYBACK, latch, payload, HG_SIZE_TRACE_PLAYBACK);
        return;
    }
    trace.index = latch->key.index;
    trace.crc = latch->crc;
    hg_trace_write(payload, &trace);
    send_trace(board, HG_TYPE_TRACE, latch, payload, HG_SIZE_TRACE);
}

void trace_report(struct board *board, const struct latch *latch)
{
    if (board->config.trace_mode == HG_TRACE_RING)
        remember(board, latch);
    else if (board->config.trace_mode == HG_TRACE_DRIVE)
        report_drive(board, latch);
    else if (board->config.trace_mode == HG_TRACE_CRC)
        report_crc(board, latch);
}

void trace_read(struct board *board, const struct request *request)
{
    struct hg_read_trace asked;
    struct hg_trace_reply reply;
    size_t length = HG_SIZE_TRACE_REPLY;
    size_t i;

    hg_read_trace_read(&asked, request->payload);
    reply.next = board->latches;
    reply.oldest = board->ring_count > 0 ? number_at(board, 0) : board->latches;
    hg_trace_reply_write(board->scratch, &reply);
    for (i = 0; i < board->ring_count; i++) {
        uint32_t number = number_at(board, i);

        if (number < asked.first || number >= (uint64_t)asked.first + asked.count
            || length + HG_SIZE_TRACE_RECORD
                   > HG_SIZE_TRACE_REPLY + BOARD_TAIL(HG_SIZE_TRACE_REPLY))
            continue;
        memcpy(board->scratch + length, board->ring[(board->ring_first + i) % BOARD_RING],
               HG_SIZE_TRACE_RECORD);
        length += HG_SIZE_TRACE_RECORD;
    }
    link_reply(board, request, board->scratch, length);
}
