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

static void start_timer(struct board *board, struct timer *timer, int64_t deadline_us,
                        uint8_t reason)
{
    timer->running = 1;
    timer->deadline_us = deadline_us;
    timer->ramp_us = (int64_t)board->config.ramp_ms * 1000;
    timer->ceiling = timer->cut = board->config.amplitude_ceiling;
    timer->reason = reason;
}

void output_renew_lease(struct board *board)
{
    int plays = board->playback.sequence != NULL;
    int64_t alone_ms = plays ? board->playback.unattended_ms : board->config.host_timeout_ms;

    if (board->state == HG_STATE_ARMED)
        start_timer(board, &board->lease, board->now_us + alone_ms * 1000,
                    plays ? HG_REASON_UNATTENDED : HG_REASON_HOST_SILENT);
}

/* A hold that still runs gets its new length; a ramp that has begun goes on, below the new ceiling
   (HG-7.1/3).  That of the lease is over: SET_CONFIG has renewed it. */
void output_reconfigure(struct board *board)
{
    int64_t deadline_us = board->last_boundary_us + (int64_t)board->config.hold_ms * 1000;

    if (board->state != HG_STATE_ARMED)
        return;
    if (board->hold.running && board->hold.deadline_us > board->now_us)
        start_timer(board, &board->hold, deadline_us > board->now_us ? deadline_us : board->now_us,
                    HG_REASON_HOLD_EXPIRED);
    board->hold.cut = lesser(board->hold.cut, board->config.amplitude_ceiling);
    output_renew_lease(board);
}

static int64_t end_us(const struct timer *timer)
{
    return timer->running ? timer->deadline_us + timer->ramp_us : BOARD_NEVER;
}

int64_t output_end_us(const struct board *board)
{
    int64_t lease_us = end_us(&board->lease);
    int64_t hold_us = end_us(&board->hold);

    if (board->state != HG_STATE_ARMED)
        return BOARD_NEVER;
    return lease_us < hold_us ? lease_us : hold_us;
}

uint8_t output_end_reason(const struct board *board)
{
    int by_lease = end_us(&board->lease) <= end_us(&board->hold);

    return by_lease ? board->lease.reason : board->hold.reason;
}

/* Return when the first ramp begins or began. */
static int64_t fade_begins_us(const struct board *board)
{
    int64_t lease_us = board->lease.running ? board->lease.deadline_us : BOARD_NEVER;
    int64_t hold_us = board->hold.running ? board->hold.deadline_us : BOARD_NEVER;

    return lease_us < hold_us ? lease_us : hold_us;
}

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
    board->fading = fade_begins_us(board) <= board->now_us;
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
    board->hold.running = 0; /* HG-6.11/4: a latch ends the ramp of the hold */
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
    board->lease.running = board->hold.running = 0;
    board->sounding = board->fading = 0;
    board->ahead.loaded = 0;
    if (board->machine.radiate != NULL)
        board->machine.radiate(board->machine.context, NULL, board->now_us);
}

/* --- Ramps and settings that a machine is to follow -------------------------------------------- */

int64_t output_step_us(const struct board *board)
{
    int64_t begins_us = fade_begins_us(board);
    int64_t next_us = board->shown_us + BOARD_RAMP_STEP_US;

    if (board->machine.radiate == NULL || !board->sounding)
        return BOARD_NEVER;
    if (board->shown_settings != board->settings)
        return board->now_us; /* ceiling or correction is another one (HG-7.9) */
    if (board->fading && begins_us > board->now_us)
        return board->now_us; /* the timer was renewed: full amplitude again */
    return begins_us > next_us ? begins_us : next_us;
}

void output_step(struct board *board)
{
    radiate(board, board->now_us);
    board->ahead.loaded = 0; /* the step may have taken the second registers */
}

/* --- What leaves the transducers (HG-7.9, HG-6.11) -------------------------------------------- */

/* Return what a ramp leaves of a latched amplitude. */
static uint8_t ramped(const struct board *board, const struct timer *timer, uint8_t latched)
{
    int64_t left_us = end_us(timer) - board->now_us;
    int64_t twice = 2 * lesser(latched, timer->ceiling) * left_us;

    if (left_us <= 0)
        return 0;
    return lesser((uint8_t)((twice + timer->ramp_us) / (2 * timer->ramp_us)), timer->cut);
}

static void fade(const struct board *board, const struct timer *timer, struct drive *drive)
{
    size_t n;

    if (!timer->running || board->now_us < timer->deadline_us)
        return;
    for (n = 0; n < board->count; n++)
        drive->amplitude[n] =
            lesser(drive->amplitude[n], ramped(board, timer, board->latched.amplitude[n]));
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
    if (!board->sounding) {
        memset(drive, 0, sizeof *drive);
        return;
    }
    output_shape(board, &board->latched, drive);
    fade(board, &board->lease, drive);
    fade(board, &board->hold, drive);
}
