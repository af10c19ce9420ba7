/* Fuzz the codec and the board: fuzz [INPUTS [SEED]], by its own seeded mutator.

   Built with -DHG_LIBFUZZER it is a libFuzzer target instead: clang -fsanitize=fuzzer,address.
   For any bytes four things hold: the parser finds the same frames in one piece as byte by byte, a
   frame that is built again is the same frame, the watch of the interrupt finds MUTE where the parser
   does, and the board counts every frame once. */

#include <stdio.h>
#include <stdlib.h>

#include "../board/board.h"
#include "../board/mute_watch.h"

enum { LONGEST = 12000, STORE = 1000 };

#define DEMAND(condition)                                                                          \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            fprintf(stderr, "fuzz: does not hold: %s\n", #condition);                              \
            abort();                                                                               \
        }                                                                                          \
    } while (0)

/* --- What must hold --------------------------------------------------------------------------- */

static void check_again(const struct hg_frame *frame)
{
    static uint8_t wire[BOARD_FRAME];
    static struct hg_parser parser;
    struct hg_frame again;
    size_t taken;
    size_t length = hg_build_frame(wire, sizeof wire, &frame->header, frame->payload,
                                   frame->payload_length);

    DEMAND(length > 2);
    hg_parser_reset(&parser);
    DEMAND(hg_parse(&parser, wire, length, &taken, &again) == HG_PARSED_FRAME);
    DEMAND(taken == length && again.body_length == frame->body_length);
    DEMAND(memcmp(again.body, frame->body, frame->body_length) == 0);
}

/* Return a checksum of all that the parser found. */
static uint32_t digest(const uint8_t *data, size_t length, size_t chunk)
{
    static struct hg_parser parser;
    uint32_t crc = 0;
    size_t at = 0;

    hg_parser_reset(&parser);
    while (at < length) {
        size_t part = length - at < chunk ? length - at : chunk;
        struct hg_frame frame;
        size_t taken, offset;
        enum hg_parsed what = hg_parse(&parser, data + at, part, &taken, &frame);

        DEMAND(taken >= 1 && taken <= part && parser.length <= HG_MAX_ENCODED_BYTES);
        at += taken;
        if (what == HG_PARSED_FRAME) {
            crc = hg_crc32(crc, frame.body, frame.body_length);
            hg_check_message(frame.header.type, frame.payload, frame.payload_length, &offset);
            if (chunk == 1)
                check_again(&frame);
        } else if (what == HG_PARSED_DAMAGE) {
            uint8_t reason = (uint8_t)frame.reason;
            crc = hg_crc32(crc, &reason, 1);
        }
    }
    return crc;
}

/* The interrupt and the main loop see the same MUTE at the same byte. */
static void check_watch(const uint8_t *data, size_t length)
{
    static struct hg_parser parser;
    static struct mute_watch watch;
    size_t i;

    hg_parser_reset(&parser);
    memset(&watch, 0, sizeof watch);
    for (i = 0; i < length; i++) {
        struct hg_frame frame;
        size_t taken;
        int is_mute = hg_parse(&parser, data + i, 1, &taken, &frame) == HG_PARSED_FRAME
                      && frame.header.type == HG_TYPE_MUTE;

        DEMAND(mute_watch_take(&watch, data[i]) == is_mute);
    }
}

/* HG-3.9/2: what became of the frames. */
static uint32_t explained(const struct board *board)
{
    static const uint8_t terms[] = {
        HG_COUNTER_ACCEPTED,
        HG_COUNTER_REQUESTS,      HG_COUNTER_REPEATED,      HG_COUNTER_DUPLICATE,
        HG_COUNTER_STALE_SESSION, HG_COUNTER_BAD_LENGTH,    HG_COUNTER_BAD_VALUE,
        HG_COUNTER_UNKNOWN_TYPE,  HG_COUNTER_UNSUPPORTED,   HG_COUNTER_DROPPED_STATE,
        HG_COUNTER_DROPPED_ORDER, HG_COUNTER_DROPPED_FULL,  HG_COUNTER_DROPPED_FUTURE,
        HG_COUNTER_DROPPED_LATE,
    };
    uint32_t sum = 0;
    size_t i;

    for (i = 0; i < sizeof terms; i++)
        sum += board->counters[terms[i]];
    return sum;
}

/* HG-5.7/8: an accepted frame waits, was latched or was flushed. */
static uint32_t accepted(const struct board *board)
{
    return board->counters[HG_COUNTER_LATCHED] + board->counters[HG_COUNTER_FLUSHED]
           + (uint32_t)board->queued;
}

static void check_board(const uint8_t *data, size_t length)
{
    struct mute_watch watch;
    static struct board board;
    static uint8_t store[STORE];
    static const struct array array = {4, 4, 10000, 1};
    static const struct machine machine = {.store = store, .store_bytes = STORE};
    int64_t t_us = BOARD_BOOT_US;
    size_t at = 0, i;

    memset(&watch, 0, sizeof watch);
    board_start(&board, &array, &machine);
    while (at < length) {
        size_t part = data[at] % 97u + 1u;

        part = part < length - at ? part : length - at;
        t_us += data[at] * 64;
        for (i = 0; i < part; i++)
            if (mute_watch_take(&watch, data[at + i]) && (data[at] & 2))
                board_mute_ahead(&board, i + 1); /* before the frames ahead of it, or in their order */
        if (data[at] % 8 == 5) /* something else than the watch takes what comes for a MUTE */
            board_mute_ahead(&board, part);
        board_receive(&board, data + at, part, t_us);
        DEMAND(!board.muting.ahead && !board.muting.changed && !board.muting.played);
        DEMAND(board.queued <= BOARD_QUEUE && board.output_length <= BOARD_OUTPUT);
        DEMAND(explained(&board) == board.counters[HG_COUNTER_FRAMES]);
        if (board.stored == 0) /* latches of a playback are no frames */
            DEMAND(accepted(&board) == board.counters[HG_COUNTER_ACCEPTED]);
        DEMAND(board.state == HG_STATE_ARMED || !board.sounding);
        if (data[at] & 1)
            board_sent(&board, board.output_length);
        at += part;
    }
    board_advance(&board, t_us + 30 * 1000000);
    if (board.state == HG_STATE_ARMED) /* a playback may go on longer than any other timer */
        board_advance(&board, t_us + 700 * (int64_t)1000000);
    DEMAND(board.state != HG_STATE_ARMED && board.queued == 0);
    DEMAND(explained(&board) >= board.counters[HG_COUNTER_FRAMES]);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t length);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t length)
{
    DEMAND(digest(data, length, length) == digest(data, length, 1));
    DEMAND(digest(data, length, 7) == digest(data, length, 1));
    check_watch(data, length);
    check_board(data, length);
    return 0;
}

/* --- A mutator of our own --------------------------------------------------------------------- */

#ifndef HG_LIBFUZZER

static uint32_t state;

static uint32_t next(uint32_t below)
{
    state ^= state << 13; /* Marsaglia's xorshift */
    state ^= state >> 17;
    state ^= state << 5;
    return state % below;
}

static const struct {
    uint8_t type;
    uint16_t fixed, unit;
} layouts[] = {
#define LAYOUT(name, type, fixed, unit, least) {type, fixed, unit},
    HG_MESSAGES(LAYOUT)
#undef LAYOUT
};

static void fill(uint8_t *to, size_t length)
{
    static const uint8_t edges[] = {0, 1, 2, 8, 0x7F, 0x80, 0xFE, 0xFF};
    size_t i;

    for (i = 0; i < length; i++)
        to[i] = (uint8_t)(next(3) != 0 ? edges[next(sizeof edges)] : next(256));
}

/* A frame that passes most checks: right length, one session, rising numbers. */
static size_t add_frame(uint8_t *to, size_t room, uint16_t *seq, uint16_t *index)
{
    uint8_t payload[300];
    size_t which = next(sizeof layouts / sizeof layouts[0]);
    size_t length = layouts[which].fixed;
    struct hg_header header;

    if (layouts[which].type == HG_TYPE_HELLO || layouts[which].type >= 0x80)
        which = 4; /* ARM: most of the others need it */
    length = layouts[which].fixed;
    header.type = layouts[which].type;
    if (next(16) == 0)
        header.type = (uint8_t)next(256);
    if (next(8) == 0)
        header.type = HG_TYPE_MUTE; /* with any payload: HG-6.4/1 */
    header.flags = next(2) != 0 && header.type < 0x40 ? HG_FLAG_IMMEDIATE : 0;
    header.seq = header.type < 0x40 ? (*index)++ : (*seq)++;
    header.time_us = (uint32_t)BOARD_BOOT_US + next(200000);
    header.session = 7;
    if (layouts[which].unit != 0)
        length += layouts[which].unit * (next(2) != 0 ? next(8) : 16u);
    fill(payload, length);
    if (header.type == HG_TYPE_MUTE && next(2) != 0) { /* runs of 254 bytes without a zero */
        length = next(sizeof payload);
        memset(payload, 0x55, length);
    }
    if (header.type == HG_TYPE_PHASES || header.type == HG_TYPE_DRIVES)
        payload[0] = 8, payload[1] = 0;
    return hg_build_frame(to, room, &header, payload, length);
}

static size_t add_hello(uint8_t *to, size_t room)
{
    static const uint8_t payload[HG_SIZE_HELLO] = {HG_VERSION_MAJOR, HG_VERSION_MINOR, 7, 0};
    struct hg_header header;

    memset(&header, 0, sizeof header);
    header.type = HG_TYPE_HELLO;
    return hg_build_frame(to, room, &header, payload, sizeof payload);
}

/* Send a frame with a valid header around the payload. */
static size_t add_request(uint8_t *to, size_t room, uint16_t *seq, uint8_t type, uint8_t flags,
                          const uint8_t *payload, size_t length)
{
    struct hg_header header;

    memset(&header, 0, sizeof header);
    header.type = type;
    header.flags = flags;
    header.seq = (*seq)++;
    header.session = 7;
    return hg_build_frame(to, room, &header, payload, length);
}

/* An upload that is played: chance alone does not find such a sequence. */
static size_t add_playback(uint8_t *to, size_t room, uint16_t *seq)
{
    uint8_t chunk[HG_SIZE_UPLOAD_CHUNK + 48] = {0};
    struct hg_upload_begin begin = {HG_UPLOAD_PHASES, 0, 1, 48, 0};
    struct hg_play play = {1, 100 + next(500), next(3), 1 + next(600)};
    uint8_t payload[16];
    size_t length = 0;

    fill(chunk + HG_SIZE_UPLOAD_CHUNK, 48);
    begin.crc = hg_crc32(0, chunk + HG_SIZE_UPLOAD_CHUNK, 48);
    if (next(2) != 0) { /* 16 bytes each are three frames of phases, or three points */
        begin.kind = HG_UPLOAD_POINTS;
        begin.points_per_frame = 1;
    }
    hg_upload_begin_write(payload, &begin);
    length += add_request(to + length, room - length, seq, HG_TYPE_UPLOAD_BEGIN, 0, payload,
                          HG_SIZE_UPLOAD_BEGIN);
    length += add_request(to + length, room - length, seq, HG_TYPE_UPLOAD_CHUNK, 0, chunk,
                          sizeof chunk);
    hg_put_u16(payload, 1);
    length += add_request(to + length, room - length, seq, HG_TYPE_UPLOAD_COMMIT, 0, payload,
                          HG_SIZE_UPLOAD_COMMIT);
    length += add_request(to + length, room - length, seq, HG_TYPE_ARM, 0, payload, 0);
    hg_play_write(payload, &play);
    length += add_request(to + length, room - length, seq, HG_TYPE_PLAY, HG_FLAG_IMMEDIATE, payload,
                          HG_SIZE_PLAY);
    return length;
}

/* More frames than the queue holds, each later than the one before. */
static size_t add_stream(uint8_t *to, size_t room, uint16_t *seq, uint16_t *index)
{
    uint8_t payload[16];
    uint32_t count = next(2 * BOARD_QUEUE) + 1;
    struct hg_header header = {HG_TYPE_PHASES, 0, 0, (uint32_t)BOARD_BOOT_US + 300000, 7};
    size_t length = add_request(to, room, seq, HG_TYPE_ARM, 0, payload, 0);

    while (count-- > 0) {
        fill(payload, sizeof payload);
        header.seq = (*index)++;
        header.time_us += next(100);
        length += hg_build_frame(to + length, room - length, &header, payload, sizeof payload);
    }
    return length;
}

static size_t mutate(uint8_t *data, size_t length)
{
    size_t at = next((uint32_t)length);
    size_t count = next(64) + 1;

    switch (next(5)) {
    case 0:
        data[at] ^= (uint8_t)(1u << next(8));
        return length;
    case 1: /* cut off */
        return at + 1;
    case 2: /* drop a piece */
        count = count < length - at ? count : length - at;
        memmove(data + at, data + at + count, length - at - count);
        return length - count > 0 ? length - count : 1;
    case 3: /* junk over a piece */
        fill(data + at, count < length - at ? count : length - at);
        return length;
    default: /* a long run without a zero */
        count = next(LONGEST - (uint32_t)length);
        memset(data + length, 0x55, count);
        return length + count;
    }
}

static size_t make_input(uint8_t *data)
{
    uint16_t seq = 1, index = HG_FIRST_STREAM_SEQ;
    size_t length = add_hello(data, LONGEST);
    uint32_t count = next(24) + 1;

    if (next(4) == 0)
        length += add_playback(data + length, LONGEST - length, &seq);
    if (next(4) == 0)
        length += add_stream(data + length, LONGEST - length, &seq, &index);
    while (count-- > 0 && length < LONGEST / 2)
        length += add_frame(data + length, LONGEST - length, &seq, &index);
    for (count = next(4); count > 0; count--)
        length = mutate(data, length);
    return length;
}

int main(int count, char **values)
{
    static uint8_t data[LONGEST + 64];
    unsigned long inputs = count > 1 ? strtoul(values[1], NULL, 10) : 10000;
    unsigned long i;

    state = (uint32_t)(count > 2 ? strtoul(values[2], NULL, 10) : 1);
    state = state != 0 ? state : 1; /* xorshift stays at 0 */
    for (i = 0; i < inputs; i++)
        LLVMFuzzerTestOneInput(data, make_input(data));
    printf("%lu inputs\n", inputs);
    return 0;
}

#endif
