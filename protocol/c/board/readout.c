/* Identity, status, geometry and drive.  SPEC.md HG-4.3, HG-7.5, HG-8.6 and chapter 9. */

#include "readout.h"

#include "link.h"
#include "output.h"
#include "points.h"
#include "uploads.h"

static size_t least(size_t a, size_t b)
{
    return a < b ? a : b;
}

/* --- Identity and status ---------------------------------------------------------------------- */

void readout_identity(const struct board *board, struct hg_hello_reply *reply)
{
    static const char firmware[] = "haptogram-c99 1";

    memset(reply, 0, sizeof *reply);
    reply->major = HG_VERSION_MAJOR;
    reply->minor = HG_VERSION_MINOR;
    reply->nonce = board->link.session;
    reply->features = HG_FEATURE_AMPLITUDE | HG_FEATURE_POINTS | HG_FEATURE_SEQUENCE_PHASES
                      | HG_FEATURE_SEQUENCE_POINTS | HG_FEATURE_CONFIG | HG_FEATURE_CORRECTION
                      | HG_FEATURE_READ_LATCHED | HG_FEATURE_READ_RADIATED | HG_FEATURE_TRACE
                      | HG_FEATURE_TRACE_DRIVE | HG_FEATURE_TRACE_RING;
    if (board->machine.kept != NULL)
        reply->features |= HG_FEATURE_CONFIG_KEPT;
    reply->clock_hz = 1000000;
    reply->clock_ppm = 50;
    reply->carrier_hz = BOARD_CARRIER_HZ;
    reply->transducers = board->count;
    reply->grid_nx = board->array.nx;
    reply->grid_ny = board->array.ny;
    reply->pitch_um = board->array.pitch_um;
    reply->geometry_hash = board->geometry_hash;
    reply->sound_speed_mm_s = board->config.sound_speed_mm_s;
    reply->max_points = BOARD_MAX_POINTS;
    reply->state = board->state;
    reply->queue_depth = BOARD_QUEUE;
    reply->trace_ring = BOARD_RING;
    reply->max_horizon_us = BOARD_HORIZON_US;
    reply->rx_window = BOARD_RX_WINDOW;
    reply->max_frame_rate_hz = BOARD_CARRIER_HZ;
    reply->max_sequence_frames = BOARD_SEQUENCE_FRAMES;
    reply->max_upload_bytes = upload_limit(board, 0);
    reply->max_playback_rate_hz = BOARD_PLAYBACK_HZ;
    reply->max_unattended_ms = BOARD_UNATTENDED_MS;
    reply->upload_window = BOARD_UPLOAD_WINDOW;
    reply->max_chunk = BOARD_CHUNK_BYTES;
    reply->latch_lead_us = BOARD_LATCH_LEAD_US;
    reply->point_time_us = BOARD_POINT_TIME_US;
    reply->boot_id = board->array.boot_id;
    reply->config_crc = readout_config_crc(board);
    memcpy(reply->firmware, firmware, sizeof firmware);
}

uint32_t readout_config_crc(const struct board *board)
{
    uint8_t config[HG_SIZE_CONFIG];

    hg_config_write(config, &board->config);
    return hg_crc32(hg_crc32(0, config, sizeof config), board->correction, board->count);
}

static int32_t clipped(int64_t value)
{
    if (value > INT32_MAX)
        return INT32_MAX;
    return value < INT32_MIN ? INT32_MIN : (int32_t)value;
}

/* Round down, negative numbers too. */
static int64_t mean(const struct margins *margins)
{
    int64_t count = margins->count;
    int64_t quotient;

    if (count == 0)
        return 0;
    quotient = margins->total_us / count;
    return margins->total_us % count < 0 ? quotient - 1 : quotient;
}

void readout_status(struct board *board, uint8_t *payload)
{
    struct margins *margins = &board->margins;
    struct hg_status status;
    size_t i;

    memset(&status, 0, sizeof status);
    status.state = board->state;
    status.reason = board->reason;
    status.queued = (uint16_t)board->queued;
    status.free_bytes = BOARD_RX_WINDOW; /* received bytes never wait */
    status.last_seq = board->last_index;
    status.last_latch_us = board->has_latched ? (uint32_t)board->latest.t_us : 0;
    status.margins = (uint16_t)least(margins->count, 0xFFFF);
    status.margin_min_us = clipped(margins->count != 0 ? margins->least_us : 0);
    status.margin_mean_us = clipped(mean(margins));
    status.config_crc = readout_config_crc(board);
    memset(margins, 0, sizeof *margins);
    hg_status_write(payload, &status);
    for (i = 0; i < HG_COUNTERS; i++)
        hg_put_u32(payload + HG_OFFSET_STATUS_COUNTERS + 4 * i, board->counters[i]);
}

uint32_t readout_least_status_ms(const struct board *board)
{
    const uint32_t tenth_ms = HG_FRAME_BOUND(HG_HEADER_BYTES + HG_SIZE_STATUS) * 10u * 1000u;
    uint32_t rate = board->machine.line_bytes_per_s;
    uint32_t least_ms = rate == 0 ? 0 : (tenth_ms + rate - 1) / rate;

    if (least_ms > 0xFFFF)
        return 0xFFFF;
    return least_ms < 10 ? 10 : least_ms;
}

void readout_schedule_status(struct board *board)
{
    int64_t period_us = (int64_t)board->config.status_period_ms * 1000;

    board->next_status_us = period_us > 0 ? board->now_us + period_us : BOARD_NEVER;
}

void readout_send_status(struct board *board)
{
    struct margins margins = board->margins;
    uint8_t payload[HG_SIZE_STATUS];

    readout_status(board, payload);
    if (!link_event(board, HG_TYPE_STATUS, payload, sizeof payload, board->now_us, 0, STATUS))
        board->margins = margins; /* HG-9.3: it gave way, and has told nobody */
    readout_schedule_status(board);
}

/* --- Geometry and drive ----------------------------------------------------------------------- */

/* Set the number of transducers in the reply; refuse and return 0 if `first` does not exist. */
static int span(struct board *board, const struct request *request, uint16_t first, uint16_t asked,
                size_t fits, size_t *count)
{
    if (first >= board->count) {
        link_refuse(board, request, HG_ERROR_NOT_FOUND, board->count);
        return 0;
    }
    *count = least(least(asked, fits), (size_t)(board->count - first));
    return 1;
}

void readout_geometry(struct board *board, const struct request *request)
{
    struct hg_get_geometry asked;
    struct hg_geometry_reply reply;
    size_t count, i;

    hg_get_geometry_read(&asked, request->payload);
    if (!span(board, request, asked.first, asked.count,
              BOARD_TAIL(HG_SIZE_GEOMETRY_REPLY) / HG_SIZE_ELEMENT, &count))
        return;
    reply.total = board->count;
    reply.first = asked.first;
    hg_geometry_reply_write(board->scratch, &reply);
    for (i = 0; i < count; i++)
        points_element(board, asked.first + i,
                       board->scratch + HG_SIZE_GEOMETRY_REPLY + i * HG_SIZE_ELEMENT);
    link_reply(board, request, board->scratch, HG_SIZE_GEOMETRY_REPLY + count * HG_SIZE_ELEMENT);
}

void readout_drive(struct board *board, const struct request *request)
{
    uint8_t *data = board->scratch + HG_SIZE_DRIVE_REPLY;
    struct hg_read_drive asked;
    struct hg_drive_reply reply;
    const struct drive *drive = &board->latched;
    struct drive radiated;
    size_t count;

    hg_read_drive_read(&asked, request->payload);
    if (!span(board, request, asked.first, asked.count, BOARD_TAIL(HG_SIZE_DRIVE_REPLY) / 2,
              &count))
        return;
    if (asked.kind == HG_DRIVE_RADIATED) {
        output_radiated(board, &radiated);
        drive = &radiated;
    }
    reply.kind = asked.kind;
    reply.key = board->latest.key;
    reply.t_latch_us = (uint32_t)board->latest.t_us;
    reply.first = asked.first;
    hg_drive_reply_write(board->scratch, &reply);
    memcpy(data, drive->phase + asked.first, count);
    memcpy(data + count, drive->amplitude + asked.first, count);
    link_reply(board, request, board->scratch, HG_SIZE_DRIVE_REPLY + 2 * count);
}
