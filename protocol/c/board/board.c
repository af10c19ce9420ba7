/* Bytes, time and power of the board. */

#include "board.h"

#include "ahead.h"
#include "judge.h"
#include "kept.h"
#include "link.h"
#include "output.h"
#include "playback.h"
#include "points.h"
#include "readout.h"
#include "shutdown.h"
#include "stream.h"
#include "uploads.h"

static uint32_t geometry_hash(const struct board *board)
{
    uint32_t crc = 0;
    uint8_t element[HG_SIZE_ELEMENT];
    size_t n;

    for (n = 0; n < board->count; n++) {
        points_element(board, n, element);
        crc = hg_crc32(crc, element, sizeof element);
    }
    return crc;
}

static void set_default_config(struct board *board)
{
    struct hg_config *config = &board->config;
    uint32_t least_ms = readout_least_status_ms(board);

    memset(config, 0, sizeof *config);
    config->hold_ms = 200;
    config->ramp_ms = 50;
    config->host_timeout_ms = 500;
    config->status_period_ms = (uint16_t)(least_ms > 100 ? least_ms : 100);
    config->sound_speed_mm_s = 343987;
    config->trace_mode = HG_TRACE_OFF;
    config->amplitude_ceiling = 255;
    config->trace_divider = 1;
}

void board_start(struct board *board, const struct array *array, const struct machine *machine)
{
    memset(board, 0, sizeof *board);
    board->array = *array;
    board->machine = *machine;
    board->count = (uint16_t)(array->nx * array->ny);
    board->geometry_hash = geometry_hash(board);
    board->now_us = BOARD_BOOT_US;
    board->last_boundary_us = BOARD_BOOT_US - BOARD_CARRIER_US;
    board->next_status_us = BOARD_NEVER;
    board->lease.deadline_us = board->hold.deadline_us = BOARD_NEVER;
    board->state = HG_STATE_DISARMED;
    board->reason = HG_REASON_NEVER_ARMED;
    set_default_config(board);
    kept_take(board);
    hg_parser_reset(&board->link.parser);
}

/* The end of what a MUTE has overtaken; of one that was found and is none, what it did is told here. */
static void pass(struct board *board, size_t length)
{
    struct muting *muting = &board->muting;

    if (muting->ahead > 0 && length >= muting->ahead)
        shutdown_mute_answered(board, 0);
    muting->ahead -= length < muting->ahead ? length : muting->ahead;
}

void board_receive(struct board *board, const uint8_t *data, size_t length, int64_t t_us)
{
    board_advance(board, t_us);
    while (length > 0) {
        struct hg_frame frame;
        size_t taken = 0;
        enum hg_parsed what = hg_parse(&board->link.parser, data, length, &taken, &frame);

        data += taken;
        length -= taken;
        if (what == HG_PARSED_DAMAGE)
            link_count(board, frame.reason);
        else if (what == HG_PARSED_FRAME)
            judge_frame(board, &frame, t_us);
        pass(board, taken);
        kept_give(board);
        board_advance(board, board->now_us); /* the frame may have made an event due now */
    }
}

void board_mute_ahead(struct board *board, size_t bytes)
{
    if (bytes <= board->muting.ahead)
        return; /* this MUTE is known */
    board->muting.ahead = bytes;
    shutdown_by_mute(board);
    ahead_load(board);
}

static int64_t earlier(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

static int64_t latch_us(const struct board *board)
{
    const struct entry *entry = stream_next(board);

    return entry != NULL ? entry->t_latch_us : BOARD_NEVER;
}

int64_t board_next_event(const struct board *board)
{
    int64_t t_us = earlier(latch_us(board), playback_due_us(board));

    t_us = earlier(t_us, output_ramp_us(board));
    t_us = earlier(t_us, output_end_us(board));
    t_us = earlier(t_us, output_step_us(board));
    return earlier(t_us, board->next_status_us);
}

/* At one moment latches precede timers, and both precede the STATUS that reports them. */
static void handle_next(struct board *board, int64_t t_us)
{
    if (latch_us(board) <= t_us)
        stream_latch(board);
    else if (playback_due_us(board) <= t_us)
        playback_latch(board, ahead_playback_drive(board));
    else if (output_ramp_us(board) <= t_us)
        output_begin_ramp(board);
    else if (output_end_us(board) <= t_us)
        shutdown_by_timer(board);
    else if (output_step_us(board) <= t_us)
        output_step(board);
    else
        readout_send_status(board);
}

void board_advance(struct board *board, int64_t t_us)
{
    int64_t next_us;

    while ((next_us = board_next_event(board)) <= t_us) {
        if (next_us > board->now_us)
            board->now_us = next_us;
        handle_next(board, next_us);
        ahead_load(board);
    }
    if (t_us > board->now_us)
        board->now_us = t_us;
    ahead_load(board);
}

const uint8_t *board_output(const struct board *board, size_t *length)
{
    *length = board->output_length;
    return board->output + board->output_first;
}

void board_sent(struct board *board, size_t length)
{
    board->output_first += length;
    board->output_length -= length;
    if (board->output_length == 0)
        board->output_first = 0;
}

void board_raise_hardware_fault(struct board *board)
{
    uint8_t before = board->state;

    output_enter(board, FAULT_FOUND, HG_REASON_FAULT);
    if (board->state != before)
        output_send_state(board);
    shutdown_output(board);
}
