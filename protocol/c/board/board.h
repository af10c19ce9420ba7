/* The board side of the Haptogram wire protocol, without a line and without a clock.

   Time is an argument: unwrapped device microseconds.  Bytes go in with board_receive, bytes come
   out of `output`, and what happens by itself happens in board_advance, at its own time and in
   order of time.  reference_board.c gives it a pseudo-terminal and the time of day. */

#ifndef BOARD_H
#define BOARD_H

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

/* Full output until `deadline_us`, silence `ramp_us` later; nothing else says that a ramp is on. */
struct fuse {
    int burning;
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
    uint8_t greeting[HG_SIZE_HELLO_REPLY]; /* for the same HELLO once more */
    int answered; /* whether the three below hold the remembered reply */
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
    int sounding; /* something was latched since the output was last off */
    struct fuse lease, hold;

    struct entry queue[BOARD_QUEUE];
    size_t queue_first, queued;
    struct margins margins;

    struct drive latched; /* registers */
    struct latch latest;
    int has_latched; /* in this session */
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

/* A request, judged as far as the link can. */
struct request {
    struct hg_header header;
    const uint8_t *payload;
    size_t length;
    uint32_t crc;
    int in_session;
    int64_t t_rx_us;
};

/* --- For its owner (board.c) ------------------------------------------------------------------ */

void board_start(struct board *board, const struct array *array);
void board_stop(struct board *board); /* gives the memory of sequences back */
void board_receive(struct board *board, const uint8_t *data, size_t length, int64_t t_us);
void board_advance(struct board *board, int64_t t_us);
int64_t board_next_event(const struct board *board); /* BOARD_NEVER: nothing by itself */
void board_sent(struct board *board, size_t length); /* the line took so much of the output */
void board_find_fault(struct board *board);

/* --- Between its parts ------------------------------------------------------------------------ */

/* board.c */
void board_schedule_status(struct board *board);

/* link.c: sessions, sequence numbers, replies, events */
enum urgency { TRACE, STATUS, OTHER }; /* HG-9.6: trace gives way first, then STATUS */

void link_judge(struct board *board, const struct hg_frame *frame, int64_t t_us);
void link_open(struct board *board, uint16_t nonce, uint16_t seq);
void link_reply(struct board *board, const struct request *request, const uint8_t *payload,
                size_t length);
void link_refuse(struct board *board, const struct request *request, uint8_t code, uint32_t detail);
int link_event(struct board *board, uint8_t type, const uint8_t *payload, size_t length,
               int64_t t_us, uint8_t flags, enum urgency urgency);
void link_count(struct board *board, int reason);

/* requests.c */
void request_carry_out(struct board *board, const struct request *request);

/* stream.c: the queue */
void stream_submit(struct board *board, const struct hg_frame *frame, uint32_t index);
void stream_latch(struct board *board);
void stream_flush(struct board *board);

/* output.c: state, timers, latch */
enum output_input { NEW_SESSION, ARM, MUTE, DISARM, RAMP_ENDED, FAULT_FOUND, OUTPUT_INPUTS };

int output_enter(struct board *board, enum output_input input, uint8_t reason);
void output_silence(struct board *board);
void output_tell(struct board *board); /* STATE_CHANGED */
void output_renew_lease(struct board *board);
void output_reconfigure(struct board *board);
void output_latch(struct board *board, const struct hg_latch_key *key, const struct drive *drive,
                  int late);
void output_radiated(const struct board *board, struct drive *drive);
void output_time_out(struct board *board);
int64_t output_end_us(const struct board *board);
int64_t output_boundary_us(const struct board *board, int64_t t_us);

/* playback.c */
void playback_play(struct board *board, const struct request *request);
void playback_stop(struct board *board);
void playback_end(struct board *board); /* and PLAYBACK_ENDED, if something played */
int playback_cut(struct board *board, struct hg_playback_ended *ended);
void playback_tell(struct board *board, const struct hg_playback_ended *ended);
void playback_latch(struct board *board);
int64_t playback_due_us(const struct board *board);

/* uploads.c */
void upload_begin(struct board *board, const struct request *request);
void upload_chunk(struct board *board, const struct request *request);
void upload_commit(struct board *board, const struct request *request);
void upload_abandon(struct board *board);
struct sequence *upload_find(struct board *board, uint16_t id);
uint32_t upload_stored(const struct board *board);

/* points.c: the array and what it makes of focal points */
void points_element(const struct board *board, size_t number, uint8_t *to);
void points_drive(const struct board *board, const uint8_t *points, size_t count,
                  struct drive *drive);

/* readout.c: what only reads */
void readout_identity(const struct board *board, struct hg_hello_reply *reply);
void readout_status(struct board *board, uint8_t *payload); /* HG_SIZE_STATUS bytes */
void readout_geometry(struct board *board, const struct request *request);
void readout_drive(struct board *board, const struct request *request);
void readout_trace(struct board *board, const struct request *request);
uint32_t readout_config_crc(const struct board *board);
uint32_t readout_drive_crc(const struct board *board, const struct drive *drive);
void readout_report(struct board *board, const struct latch *latch);

#endif
