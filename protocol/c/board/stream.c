/* Stream frames and the queue between their arrival and their latch.  SPEC.md chapter 5. */

#include "stream.h"

#include "link.h"
#include "output.h"
#include "points.h"

static struct entry *at(struct board *board, size_t place)
{
    return &board->queue[(board->queue_first + place) % BOARD_QUEUE];
}

void stream_flush(struct board *board)
{
    board->counters[HG_COUNTER_FLUSHED] += (uint32_t)board->queued;
    board->queued = 0;
}

/* --- What a frame carries --------------------------------------------------------------------- */

/* Steps 9 and 10 of HG-3.8, as far as they depend on the array; nothing is computed here. */
static int check_drive(const struct board *board, const struct hg_frame *frame)
{
    switch (frame->header.type) {
    case HG_TYPE_PHASES:
        return frame->payload_length != board->count ? HG_COUNTER_BAD_LENGTH : HG_OK;
    case HG_TYPE_DRIVES:
        return frame->payload_length != 2u * board->count ? HG_COUNTER_BAD_LENGTH : HG_OK;
    default:
        return frame->payload_length > BOARD_MAX_POINTS * HG_SIZE_FOCAL_POINT ? HG_COUNTER_BAD_VALUE
                                                                             : HG_OK;
    }
}

static void take_drive(const struct board *board, const struct hg_frame *frame,
                       struct drive *drive)
{
    const uint8_t *codes = frame->payload;

    switch (frame->header.type) {
    case HG_TYPE_PHASES:
        memcpy(drive->phase, codes, board->count);
        memset(drive->amplitude, 255, board->count);
        break;
    case HG_TYPE_DRIVES:
        memcpy(drive->phase, codes, board->count);
        memcpy(drive->amplitude, codes + board->count, board->count);
        break;
    default:
        points_drive(board, frame->payload, frame->payload_length / HG_SIZE_FOCAL_POINT, drive);
    }
}

/* --- Queue (HG-5.7) --------------------------------------------------------------------------- */

static void add_margin(struct margins *margins, int64_t margin_us)
{
    if (margins->count == 0 || margin_us < margins->least_us)
        margins->least_us = margin_us;
    margins->total_us += margin_us;
    margins->count++;
}

int64_t stream_ready_us(const struct board *board, size_t points)
{
    int64_t begins_us = board->computed_us > board->now_us ? board->computed_us : board->now_us;

    return begins_us + (int64_t)points * BOARD_POINT_TIME_US + BOARD_LATCH_LEAD_US;
}

/* Steps 12 to 16 of HG-3.8. */
static int refusal(struct board *board, int immediate, int64_t t_apply_us, int64_t ready_us)
{
    int64_t margin_us = t_apply_us - ready_us;

    if (board->state != HG_STATE_ARMED || board->playback.sequence != NULL)
        return HG_COUNTER_DROPPED_STATE;
    if (immediate)
        return HG_OK;
    add_margin(&board->margins, margin_us);
    if (board->queued > 0 && at(board, board->queued - 1)->t_apply_us >= t_apply_us)
        return HG_COUNTER_DROPPED_ORDER;
    if (board->queued == BOARD_QUEUE)
        return HG_COUNTER_DROPPED_FULL;
    if (t_apply_us - board->now_us > BOARD_HORIZON_US)
        return HG_COUNTER_DROPPED_FUTURE;
    return -margin_us > (int64_t)board->config.late_window_us ? HG_COUNTER_DROPPED_LATE : HG_OK;
}

/* HG-5.8/3: of two frames on one carrier period the later replaces the earlier. */
static struct entry *make_room(struct board *board, int64_t t_latch_us)
{
    if (board->queued > 0 && at(board, board->queued - 1)->t_latch_us == t_latch_us)
        board->counters[HG_COUNTER_FLUSHED]++;
    else
        board->queued++;
    return at(board, board->queued - 1);
}

void stream_submit(struct board *board, const struct hg_frame *frame, uint32_t index)
{
    int immediate = (frame->header.flags & HG_FLAG_IMMEDIATE) != 0;
    int32_t ahead_us = hg_ahead_u32(frame->header.time_us, (uint32_t)board->now_us);
    size_t points = frame->header.type == HG_TYPE_POINTS
                        ? frame->payload_length / HG_SIZE_FOCAL_POINT
                        : 0;
    int64_t ready_us = stream_ready_us(board, points);
    int64_t t_apply_us = immediate ? ready_us : board->now_us + ahead_us;
    int64_t t_latch_us;
    struct entry *entry;
    int reason = check_drive(board, frame);

    if (reason == HG_OK)
        reason = refusal(board, immediate, t_apply_us, ready_us);
    if (reason != HG_OK) {
        link_count(board, reason);
        return;
    }
    if (immediate)
        stream_flush(board);
    board->computed_us = ready_us - BOARD_LATCH_LEAD_US;
    link_count(board, HG_COUNTER_ACCEPTED);
    t_latch_us = output_boundary_us(board, t_apply_us > ready_us ? t_apply_us : ready_us);
    entry = make_room(board, t_latch_us);
    entry->t_latch_us = t_latch_us;
    entry->index = index;
    entry->t_apply_us = t_apply_us;
    entry->late = t_apply_us < ready_us;
    take_drive(board, frame, &entry->drive);
}

const struct entry *stream_next(const struct board *board)
{
    return board->queued > 0 ? &board->queue[board->queue_first] : NULL;
}

void stream_latch(struct board *board)
{
    const struct entry *entry = at(board, 0);
    struct hg_latch_key key;

    board->queue_first = (board->queue_first + 1) % BOARD_QUEUE;
    board->queued--;
    key.sequence = 0;
    key.loop = 0;
    key.index = entry->index;
    board->last_index = entry->index;
    board->counters[HG_COUNTER_LATE] += (uint32_t)entry->late;
    output_latch(board, &key, &entry->drive, entry->late);
}
