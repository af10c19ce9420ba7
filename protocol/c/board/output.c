/* Output state, the two timers, and the latch.  SPEC.md chapters 5, 6 and 12. */

#include "output.h"

#include "link.h"
#include "trace.h"

#define REFUSED 0xFFu

/* HG-6.2, without the inputs that never change the state. */
static const uint8_t transitions[OUTPUT_INPUTS][4] = {
    /*               DISARMED           ARMED              MUTED           FAULT */
    [NEW_SESSION] = {HG_STATE_DISARMED, HG_STATE_DISARMED, HG_STATE_MUTED, HG_STATE_FAULT},
    [ARM] = {HG_STATE_ARMED, HG_STATE_ARMED, HG_STATE_ARMED, REFUSED},
    [MUTE] = {HG_STATE_MUTED, HG_STATE_MUTED, HG_STATE_MUTED, HG_STATE_FAULT},
    [DISARM] = {HG_STATE_DISARMED, HG_STATE_DISARMED, HG_STATE_MUTED, HG_STATE_DISARMED},
    [RAMP_ENDED] = {REFUSED, HG_STATE_MUTED, REFUSED, REFUSED},
    [FAULT_FOUND] = {HG_STATE_FAULT, HG_STATE_FAULT, HG_STATE_FAULT, HG_STATE_FAULT},
};

/* Follow the table; return 0 if the table refuses the input. */
int output_enter(struct board *board, enum output_input input, uint8_t reason)
{
    uint8_t state = transitions[input][board->state];

    if (state == REFUSED)
        return 0;
    if (state != board->state) {
        board->state = state;
        board->reason = reason;
    } else if (input == MUTE && state == HG_STATE_MUTED) {
        board->reason = reason; /* MUTE was asked for, even where a timer had muted before */
    }
    return 1;
}

void output_send_state(struct board *board)
{
    uint8_t payload[HG_SIZE_STATE_CHANGED];
    struct hg_state_changed changed;

    changed.state = board->state;
    changed.reason = board->reason;
    hg_state_changed_write(payload, &changed);
    link_event(board, HG_TYPE_STATE_CHANGED, payload, sizeof payload, board->now_us, 0, OTHER);
}

/* --- Timers (HG-12) --------------------------------------------------------------------------- */

static uint8_t lesser(uint8_t a, uint8_t b) { return a < b ? a : b; }

/* Return the timer that runs out first, or has. */
static const struct timer *first_timer(const struct board *board)
{
    return board->lease.deadline_us <= board->hold.deadline_us ? &board->lease : &board->hold;
}

static void start_timer(struct board *board, struct timer *timer, int64_t deadline_us,
                        uint8_t reason)
{
    timer->deadline_us = deadline_us;
    timer->reason = reason;
    if (first_timer(board)->deadline_us > board->now_us)
        board->ramp.running = 0; /* HG-6.11/4 */
}

void output_renew_lease(struct board *board)
{
    int plays = board->playback.sequence != NULL;
    int64_t alone_ms = plays ? board->playback.unattended_ms : board->config.host_timeout_ms;

    if (board->state == HG_STATE_ARMED)
        start_timer(board, &board->lease, board->now_us + alone_ms * 1000,
                    plays ? HG_REASON_UNATTENDED : HG_REASON_HOST_SILENT);
}

/* A hold that still runs gets its new length; a ramp that has begun goes on (HG-7.1/3). */
void output_reconfigure(struct board *board)
{
    int64_t deadline_us = board->last_boundary_us + (int64_t)board->config.hold_ms * 1000;

    if (board->state != HG_STATE_ARMED)
        return;
    if (board->hold.deadline_us > board->now_us && board->hold.deadline_us != BOARD_NEVER)
        board->hold.deadline_us = deadline_us > board->now_us ? deadline_us : board->now_us;
    output_renew_lease(board);
}

/* Return when the ramp begins or began. */
static int64_t ramp_begins_us(const struct board *board)
{
    if (board->state != HG_STATE_ARMED)
        return BOARD_NEVER;
    return board->ramp.running ? board->ramp.end_us - board->ramp.length_us
                               : first_timer(board)->deadline_us;
}

int64_t output_ramp_us(const struct board *board)
{
    return board->ramp.running ? BOARD_NEVER : ramp_begins_us(board);
}

void output_begin_ramp(struct board *board)
{
    struct ramp *ramp = &board->ramp;

    ramp->length_us = (int64_t)board->config.ramp_ms * 1000;
    ramp->end_us = first_timer(board)->deadline_us + ramp->length_us;
    ramp->ceiling = board->config.amplitude_ceiling;
    ramp->running = 1;
}

int64_t output_end_us(const struct board *board)
{
    return board->state == HG_STATE_ARMED && board->ramp.running ? board->ramp.end_us : BOARD_NEVER;
}

uint8_t output_end_reason(const struct board *board) { return first_timer(board)->reason; }

/* --- Latch (HG-5.8) --------------------------------------------------------------------------- */

/* Return the first free carrier boundary at or after a time, and not before now. */
int64_t output_boundary_us(const struct board *board, int64_t t_us)
{
    int64_t free_us = board->last_boundary_us + BOARD_CARRIER_US;
    int64_t from_us = t_us > board->now_us ? t_us : board->now_us;
    int64_t boundary_us = (from_us + BOARD_CARRIER_US - 1) / BOARD_CARRIER_US * BOARD_CARRIER_US;

    return boundary_us > free_us ? boundary_us : free_us;
}

/* Give the machine what is to be radiated now; return the time at which it took effect. */
static int64_t radiate(struct board *board, int64_t due_us)
{
    struct drive drive;

    if (board->machine.radiate == NULL)
        return due_us;
    output_radiated(board, &drive);
    board->shown_us = board->now_us;
    board->fading = board->ramp.running;
    board->shown_settings = board->settings;
    return board->machine.radiate(board->machine.context, &drive, due_us);
}

void output_latch(struct board *board, const struct hg_latch_key *key, const struct drive *drive,
                  int late)
{
    struct latch *latch = &board->latest;

    board->latched = *drive;
    board->sounding = board->has_latched = 1;
    board->last_boundary_us = board->now_us;
    start_timer(board, &board->hold, BOARD_NEVER, HG_REASON_HOLD_EXPIRED); /* it ends the ramp */
    latch->key = *key;
    latch->number = board->latches++;
    latch->t_us = radiate(board, board->now_us);
    latch->crc = trace_drive_crc(board, drive);
    latch->late = late;
    start_timer(board, &board->hold, latch->t_us + (int64_t)board->config.hold_ms * 1000,
                HG_REASON_HOLD_EXPIRED);
    board->counters[HG_COUNTER_LATCHED]++;
    trace_report(board, latch);
}

void output_off(struct board *board)
{
    board->lease.deadline_us = board->hold.deadline_us = BOARD_NEVER;
    board->sounding = board->fading = board->ramp.running = 0;
    board->ahead.loaded = 0;
    if (board->machine.radiate != NULL)
        board->machine.radiate(board->machine.context, NULL, board->now_us);
}

/* --- Ramps and settings that a machine is to follow -------------------------------------------- */

int64_t output_step_us(const struct board *board)
{
    int64_t begins_us = ramp_begins_us(board);
    int64_t next_us = board->shown_us + BOARD_RAMP_STEP_US;

    if (board->machine.radiate == NULL || !board->sounding)
        return BOARD_NEVER;
    if (board->shown_settings != board->settings)
        return board->now_us; /* ceiling or correction is another one (HG-7.9) */
    if (board->fading && !board->ramp.running)
        return board->now_us; /* full amplitude again */
    return begins_us > next_us ? begins_us : next_us;
}

void output_step(struct board *board)
{
    radiate(board, board->now_us);
    board->ahead.loaded = 0; /* the step may have taken the second registers */
}

/* --- What leaves the transducers (HG-7.9, HG-6.11) -------------------------------------------- */

/* Return what the ramp leaves of a latched amplitude. */
static uint8_t ramped(const struct board *board, uint8_t latched)
{
    const struct ramp *ramp = &board->ramp;
    int64_t left_us = ramp->end_us - board->now_us;
    int64_t twice = 2 * lesser(latched, ramp->ceiling) * left_us;

    if (left_us <= 0)
        return 0;
    return (uint8_t)((twice + ramp->length_us) / (2 * ramp->length_us));
}

void output_shape(const struct board *board, const struct drive *latched, struct drive *radiated)
{
    size_t n;

    memset(radiated, 0, sizeof *radiated);
    for (n = 0; n < board->count; n++) {
        radiated->phase[n] = (uint8_t)(latched->phase[n] + board->correction[n]);
        radiated->amplitude[n] = lesser(latched->amplitude[n], board->config.amplitude_ceiling);
    }
}

void output_radiated(const struct board *board, struct drive *drive)
{
    size_t n;

    if (!board->sounding) {
        memset(drive, 0, sizeof *drive);
        return;
    }
    output_shape(board, &board->latched, drive);
    for (n = 0; board->ramp.running && n < board->count; n++)
        drive->amplitude[n] =
            lesser(drive->amplitude[n], ramped(board, board->latched.amplitude[n]));
}
