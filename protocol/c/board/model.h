/* State and limits of the board: structures and constants, no functions. */

#ifndef BOARD_MODEL_H
#define BOARD_MODEL_H

#include "../haptogram_codec.h"

#define BOARD_BOOT_US 4284967296 /* HG-6.9: 2^32 - 10 s */
#define BOARD_NEVER INT64_MAX

#define BOARD_CARRIER_HZ 40000
#define BOARD_CARRIER_US 25
#define BOARD_QUEUE 32
#define BOARD_RING 4096
#define BOARD_MAX_POINTS 8
#define BOARD_HORIZON_US 10000000
#define BOARD_RX_WINDOW 16384
#define BOARD_PLAYBACK_HZ 10000
#define BOARD_UNATTENDED_MS 600000
#define BOARD_SEQUENCES 64
#define BOARD_SEQUENCE_FRAMES 65536
#define BOARD_UPLOAD_BYTES (32u << 20)
#define BOARD_STORED_BYTES (64u << 20)
#define BOARD_UPLOAD_WINDOW 4
#define BOARD_CHUNK_BYTES 2048
#define BOARD_RANGES 64
#define BOARD_OUTPUT 16384 /* bytes that may wait for the line */
#define BOARD_FRAME HG_FRAME_BOUND(HG_MAX_BODY_BYTES)
/* Bytes that one frame leaves for the tail of a reply. */
#define BOARD_TAIL(fixed) (HG_MAX_BODY_BYTES - HG_HEADER_BYTES - (fixed))

/* --- What the board holds --------------------------------------------------------------------- */

struct array {
    uint16_t nx, ny;
    uint32_t pitch_um;
    uint32_t boot_id;
};

struct drive {
    uint8_t phase[HG_MAX_TRANSDUCERS];
    uint8_t amplitude[HG_MAX_TRANSDUCERS];
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

/* A timer that mutes: full output until `deadline_us`, then a ramp of `ramp_us` to silence. */
struct timer {
    int running;
    uint8_t reason;
    int64_t deadline_us, ramp_us;
};

struct range {
    uint32_t start, stop;
};

struct upload {
    int begun;
    struct hg_upload_begin begin;
    uint32_t frame_bytes;
    uint8_t *data;
    struct range ranges[BOARD_RANGES + 2]; /* sorted, never touching */
    size_t range_count;
};

struct sequence {
    uint16_t id; /* 0: free */
    uint8_t kind;
    uint8_t points;
    uint32_t frame_bytes, frames;
    uint8_t *data;
};

struct playback {
    const struct sequence *sequence; /* NULL: nothing plays */
    int64_t start_us, period_us;
    uint32_t loops, unattended_ms;
    uint64_t played;
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
    uint16_t count; /* transducers */
    uint32_t geometry_hash;
    int64_t now_us;
    uint32_t counters[HG_COUNTERS];
    struct link link;

    uint8_t output[BOARD_OUTPUT];
    size_t output_length;

    struct hg_config config;
    uint8_t correction[HG_MAX_TRANSDUCERS];

    uint8_t state, reason;
    int sounding; /* 1: a drive was latched since the output was last off */
    struct timer lease, hold;

    struct entry queue[BOARD_QUEUE];
    size_t queue_first, queued;
    struct margins margins;

    struct drive latched; /* registers */
    struct latch latest;
    int has_latched; /* 1: a drive was latched in this session */
    uint32_t latches;
    uint32_t last_index;
    int64_t last_boundary_us;
    uint32_t traced;
    struct latch ring[BOARD_RING];
    size_t ring_first, ring_count;

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
