/* One function for each request that passed the checks of the link.  SPEC.md chapters 6 to 9. */

#include "requests.h"

#include "link.h"
#include "output.h"
#include "playback.h"
#include "readout.h"
#include "shutdown.h"
#include "trace.h"
#include "uploads.h"

static void reply_state(struct board *board, const struct request *request)
{
    link_reply(board, request, &board->state, 1);
}

/* --- Output state ----------------------------------------------------------------------------- */

static void arm(struct board *board, const struct request *request)
{
    if (board->muting.ahead || !output_enter(board, ARM, HG_REASON_NONE)) {
        link_refuse(board, request, HG_ERROR_BAD_STATE, board->state);
        return;
    }
    output_renew_lease(board);
    reply_state(board, request);
}

static void mute(struct board *board, const struct request *request)
{
    shutdown_by_mute(board);
    reply_state(board, request); /* HG-4.11/5: the reply precedes the events */
    shutdown_mute_answered(board, request->in_session);
}

static void disarm(struct board *board, const struct request *request)
{
    output_enter(board, DISARM, HG_REASON_DISARM);
    reply_state(board, request);
    shutdown_output(board);
}

static void ping(struct board *board, const struct request *request)
{
    uint8_t payload[HG_SIZE_PONG];
    struct hg_pong pong;

    pong.echo = hg_get_u64(request->payload);
    pong.t_rx_us = (uint32_t)request->t_rx_us;
    pong.t_tx_us = (uint32_t)link_departure_us(board);
    hg_pong_write(payload, &pong);
    link_reply(board, request, payload, sizeof payload);
}

static void get_status(struct board *board, const struct request *request)
{
    uint8_t payload[HG_SIZE_STATUS_REPLY];

    readout_status(board, payload);
    link_reply(board, request, payload, sizeof payload);
}

/* --- Configuration (HG-7.1) ------------------------------------------------------------------- */

static void reply_config(struct board *board, const struct request *request)
{
    uint8_t payload[HG_SIZE_CONFIG_REPLY];
    struct hg_config_reply reply;

    reply.config_crc = readout_config_crc(board);
    reply.config = board->config;
    hg_config_reply_write(payload, &reply);
    link_reply(board, request, payload, sizeof payload);
}

static int within(uint32_t value, uint32_t low, uint32_t high)
{
    return value >= low && value <= high;
}

/* Return 1 if every value is within its bounds; else `*offset` is that of the first wrong one. */
static int config_fits(const struct board *board, const struct hg_config *config, uint32_t *offset)
{
    *offset = HG_OFFSET_CONFIG_HOLD_MS;
    if (!within(config->hold_ms, 1, 10000))
        return 0;
    *offset = HG_OFFSET_CONFIG_RAMP_MS;
    if (!within(config->ramp_ms, 0, 2000))
        return 0;
    *offset = HG_OFFSET_CONFIG_HOST_TIMEOUT_MS;
    if (!within(config->host_timeout_ms, 20, 10000))
        return 0;
    *offset = HG_OFFSET_CONFIG_STATUS_PERIOD_MS;
    if (config->status_period_ms != 0 && config->status_period_ms < readout_least_status_ms(board))
        return 0;
    *offset = HG_OFFSET_CONFIG_LATE_WINDOW_US;
    if (!within(config->late_window_us, 0, 100000))
        return 0;
    *offset = HG_OFFSET_CONFIG_SOUND_SPEED_MM_S;
    if (!within(config->sound_speed_mm_s, 300000, 380000))
        return 0;
    *offset = HG_OFFSET_CONFIG_TRACE_DIVIDER;
    return config->trace_divider >= 1;
}

static void set_config(struct board *board, const struct request *request)
{
    struct hg_set_config message;
    uint32_t offset;

    hg_set_config_read(&message, request->payload);
    if (!config_fits(board, &message.config, &offset)) {
        link_refuse(board, request, HG_ERROR_BAD_VALUE, offset);
        return;
    }
    board->config = message.config;
    board->settings++;
    board->traced = 0;
    readout_schedule_status(board);
    reply_config(board, request); /* HG-4.11/5: the reply precedes the events */
    output_reconfigure(board);
}

/* --- Playback --------------------------------------------------------------------------------- */

static void stop(struct board *board, const struct request *request)
{
    reply_state(board, request);
    playback_stop(board);
}

/* --- Table ------------------------------------------------------------------------------------ */

typedef void (*handler)(struct board *, const struct request *);

/* By type; judge.c handles HELLO. */
static const handler handlers[0x40] = {
    [HG_TYPE_ARM - 0x40] = arm,
    [HG_TYPE_MUTE - 0x40] = mute,
    [HG_TYPE_DISARM - 0x40] = disarm,
    [HG_TYPE_PING - 0x40] = ping,
    [HG_TYPE_GET_STATUS - 0x40] = get_status,
    [HG_TYPE_GET_CONFIG - 0x40] = reply_config,
    [HG_TYPE_SET_CONFIG - 0x40] = set_config,
    [HG_TYPE_GET_GEOMETRY - 0x40] = readout_geometry,
    [HG_TYPE_READ_DRIVE - 0x40] = readout_drive,
    [HG_TYPE_UPLOAD_BEGIN - 0x40] = upload_begin,
    [HG_TYPE_UPLOAD_CHUNK - 0x40] = upload_chunk,
    [HG_TYPE_UPLOAD_COMMIT - 0x40] = upload_commit,
    [HG_TYPE_PLAY - 0x40] = playback_play,
    [HG_TYPE_STOP - 0x40] = stop,
    [HG_TYPE_READ_TRACE - 0x40] = trace_read,
};

void request_carry_out(struct board *board, const struct request *request)
{
    handler carry_out = handlers[request->header.type - 0x40];

    if (carry_out == NULL)
        link_refuse(board, request, HG_ERROR_UNSUPPORTED, request->header.type);
    else
        carry_out(board, request);
}
