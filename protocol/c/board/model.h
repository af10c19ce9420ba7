/* State of the board: structures, no functions. */

#ifndef BOARD_MODEL_H
#define BOARD_MODEL_H

#include "limits.h"

/* --- What the board holds --------------------------------------------------------------------- */

struct array {
    uint16_t nx, ny;
    uint32_t pitch_um;
    uint32_t boot_id;
};

struct drive {
    uint8_t phase[BOARD_ELEMENTS];
    uint8_t amplitude[BOARD_ELEMENTS];
};

/* What outlives a reset, if the board has memory for it: battery-backed, or copied from and to flash. */
struct kept {
    uint32_t seal;
    uint8_t config[HG_SIZE_CONFIG];
    uint8_t correction[BOARD_ELEMENTS];
};

/* The machine around the board.  Any function may be NULL, as for a board without transducers in
   virtual time.  All are called from the functions of board.h, in no interrupt. */
struct machine {
    uint8_t *store; /* memory of sequences and uploads */
    uint32_t store_bytes;
    struct kept *kept; /* as the last life left it; NULL: a reset brings back the defaults */
    uint32_t line_bytes_per_s; /* 0: no UART, and faster than any board */
    void *context; /* given to the functions */
    /* Drive the transducers; NULL: switch them off.  Return the time at which the drive took effect:
       `due_us` if the hardware switches on time, else what was measured. */
    int64_t (*radiate)(void *context, const struct drive *radiated, int64_t due_us);
    /* Load into second registers what is radiated from `due_us` on; the hardware takes it then by
       itself.  NULL: what was loaded is not to be taken.  At `due_us` radiate gets the same drive.
       `due_us` is at most BOARD_AHEAD_US ahead. */
    void (*load)(void *context, const struct drive *radiated, int64_t due_us);
    /* Return the time at which the next byte of the output leaves (HG-4.11/2). */
    int64_t (*departure_us)(void *context, size_t waiting_bytes);
};

struct latch {
    struct hg_latch_key key;
    uint32_t number;
    int64_t t_us;
    uint32_t crc;
    int late;
};

struct entry {
    uint32_t index; /* unwrapped sequence number */
    int64_t t_apply_us, t_latch_us;
    int late;
    struct drive drive;
};

/* A timer that mutes. */
struct timer {
    uint8_t reason;
    int64_t deadline_us; /* BOARD_NEVER: it does not run */
};

/* The ramp to silence; it keeps what it began with (HG-6.11/6). */
struct ramp {
    int running;
    uint8_t ceiling; /* below which its line begins */
    int64_t end_us, length_us;
};

struct upload {
    int begun;
    struct hg_upload_begin begin;
    uint32_t frame_bytes;
    uint32_t at;       /* place in the store */
    uint32_t received; /* bytes that are there */
};

struct sequence {
    uint16_t id; /* 0: free */
    uint8_t kind;
    uint8_t points;
    uint32_t frame_bytes, frames;
    uint32_t at; /* place in the store */
};

struct playback {
    const struct sequence *sequence; /* NULL: nothing plays */
    int64_t start_us, period_us;
    uint32_t loops, unattended_ms;
    uint64_t played;
};

/* MUTE that is carried out, and not answered yet: with what it led to. */
struct muting {
    size_t ahead; /* bytes to come up to the end of the last one that has arrived (HG-3.8/4) */
    int changed; /* 1: it changed the output state */
    int played; /* 1: it ended a playback */
    struct hg_playback_ended ended;
};

/* The next latch, as far as the machine has it. */
struct ahead {
    int loaded;
    int64_t due_us;
    struct hg_latch_key key;
    uint32_t settings; /* those that it was computed with */
    struct drive drive; /* of a playback, before ceiling and correction */
};

struct margins {
    uint32_t count;
    int64_t least_us, total_us;
};

struct link {
    struct hg_parser parser;
    uint16_t session; /* 0: none */
    uint32_t stream_expected; /* unwrapped */
    uint16_t control_newest;
    uint16_t event_seq;
    uint8_t greeting[HG_SIZE_HELLO_REPLY]; /* reply to a repeated HELLO */
    int answered; /* 1: the three members below hold the remembered reply */
    uint16_t answered_seq;
    uint32_t answered_crc;
    uint8_t answer[BOARD_FRAME];
    size_t answer_length;
};

struct board {
    struct array array;
    struct machine machine;
    uint16_t count; /* transducers */
    uint32_t geometry_hash;
    int64_t now_us;
    uint32_t counters[HG_COUNTERS];
    struct link link;

    uint8_t output[BOARD_OUTPUT];
    size_t output_first, output_length;

    struct hg_config config;
    uint8_t correction[BOARD_ELEMENTS];
    uint32_t settings; /* counts changes of both */
    uint32_t given;    /* those that are in the memory that outlives a reset */

    uint8_t state, reason;
    int sounding; /* 1: a drive was latched since the output was last off */
    struct muting muting;
    struct timer lease, hold;
    struct ramp ramp;
    int64_t shown_us; /* when the machine last got a drive to radiate */
    int fading;       /* 1: in a ramp then */
    uint32_t shown_settings; /* those of that drive */

    struct entry queue[BOARD_QUEUE];
    size_t queue_first, queued;
    int64_t computed_us; /* when the last accepted frame is, or was, computed */
    struct margins margins;

    struct drive latched; /* registers */
    struct latch latest;
    int has_latched; /* 1: a drive was latched in this session */
    uint32_t latches;
    uint32_t last_index;
    int64_t last_boundary_us;
    uint32_t traced;
    uint8_t ring[BOARD_RING][HG_SIZE_TRACE_RECORD];
    size_t ring_first, ring_count;

    struct ahead ahead;
    uint32_t stored; /* bytes of the store that sequences take */
    struct upload upload;
    struct sequence sequences[BOARD_SEQUENCES];
    struct playback playback;
    int64_t next_status_us;

    uint8_t scratch[HG_MAX_BODY_BYTES]; /* payload of a long reply */
};

/* A request on its way through the checks of the link. */
struct request {
    struct hg_header header;
    const uint8_t *payload;
    size_t length;
    uint32_t crc;
    int in_session;
    int64_t t_rx_us;
};

#endif
