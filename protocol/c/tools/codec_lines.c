/* The codec as a filter, for a comparison with other decoders.

   codec_lines CHUNK < LINES   each line: hex of bytes on the line, fed CHUNK at a time (0: all)
   codec_lines encode < LINES  each line: hex of a body; prints the frame

   Of every line of input, in order:
     frame TYPE FLAGS SEQ TIME SESSION     the header, then of its message
       bad REASON OFFSET                   a wrong type, length or value, or
       NAME VALUE                          every field of the fixed part
       tail NAME HEX                       bytes, or
       tail NAME COUNT                     records, and of each its fields, NAME VALUE
     drop REASON                           damage
   and a line with a dot at the end. */

#include <inttypes.h>
#include <stdlib.h>

#include "../haptogram_codec.h"
#include "hex.h"

enum { LINE = 1 << 17 };
enum kind { U8, U16, U32, U64, I16, I32, TEXT };

static char text[LINE];
static uint8_t data[LINE / 2];

static const char *const reasons[HG_COUNTERS] = {
#define REASON(upper, lower) [HG_COUNTER_##upper] = #lower,
    HG_COUNTER_NAMES(REASON)
#undef REASON
};

static const struct {
    const char *owner, *name;
    size_t offset;
    enum kind kind;
} fields[] = {
#define FIELD(owner, name, offset, kind) {#owner, #name, offset, kind},
    HG_FIELDS(FIELD)
#undef FIELD
};

static const struct {
    uint8_t type;
    const char *name;
} types[] = {
#define TYPE(name, type, fixed, unit, least) {type, #name},
    HG_MESSAGES(TYPE)
#undef TYPE
};

static const struct {
    const char *owner, *name, *record;
} tails[] = {
#define TAIL(owner, name, record) {#owner, #name, #record},
    HG_TAILS(TAIL)
#undef TAIL
};

static void print_value(enum kind kind, const uint8_t *at)
{
    switch (kind) {
    case U8:
        printf("%u", hg_get_u8(at));
        break;
    case U16:
        printf("%u", hg_get_u16(at));
        break;
    case U32:
        printf("%" PRIu32, hg_get_u32(at));
        break;
    case U64:
        printf("%" PRIu64, hg_get_u64(at));
        break;
    case I16:
        printf("%d", hg_get_i16(at));
        break;
    case I32:
        printf("%" PRId32, hg_get_i32(at));
        break;
    case TEXT:
        hex_print(at, 16);
        break;
    }
}

static void print_fields(const char *owner, const uint8_t *at)
{
    size_t i;

    for (i = 0; i < sizeof fields / sizeof fields[0]; i++) {
        if (strcmp(fields[i].owner, owner) != 0)
            continue;
        printf("%s ", fields[i].name);
        print_value(fields[i].kind, at + fields[i].offset);
        printf("\n");
    }
}

static void print_tail(const char *owner, size_t unit, const uint8_t *at, size_t length)
{
    size_t i, n;

    for (i = 0; i < sizeof tails / sizeof tails[0]; i++) {
        if (strcmp(tails[i].owner, owner) != 0)
            continue;
        printf("tail %s ", tails[i].name);
        if (strcmp(tails[i].record, "BYTES") == 0) {
            hex_print(at, length);
            printf("\n");
            continue;
        }
        printf("%u\n", (unsigned)(length / unit));
        for (n = 0; n < length; n += unit)
            print_fields(tails[i].record, at + n);
    }
}

static const char *name_of(uint8_t type)
{
    size_t i;

    for (i = 0; i < sizeof types / sizeof types[0]; i++)
        if (types[i].type == type)
            return types[i].name;
    return "";
}

static void print_frame(const struct hg_frame *frame)
{
    const struct hg_header *header = &frame->header;
    size_t fixed = 0, unit = 0, offset = 0;
    int reason = hg_check_message(header->type, frame->payload, frame->payload_length, &offset);

    printf("frame %u %u %u %" PRIu32 " %u\n", header->type, header->flags, header->seq,
           header->time_us, header->session);
    if (reason != HG_OK) {
        printf("bad %s %u\n", reasons[reason], (unsigned)offset);
        return;
    }
    hg_message_layout(header->type, &fixed, &unit);
    print_fields(name_of(header->type), frame->payload);
    print_tail(name_of(header->type), unit, frame->payload + fixed, frame->payload_length - fixed);
}

static void decode(size_t length, size_t chunk)
{
    static struct hg_parser parser;
    const uint8_t *at = data;
    const uint8_t *end = data + length;

    hg_parser_reset(&parser);
    while (at < end) {
        size_t left = (size_t)(end - at);
        size_t taken;
        struct hg_frame frame;

        switch (hg_parse(&parser, at, chunk != 0 && chunk < left ? chunk : left, &taken, &frame)) {
        case HG_PARSED_FRAME:
            print_frame(&frame);
            break;
        case HG_PARSED_DAMAGE:
            printf("drop %s\n", reasons[frame.reason]);
            break;
        case HG_PARSED_NOTHING:
            break;
        }
        at += taken;
    }
}

static void encode(size_t length)
{
    static uint8_t wire[HG_FRAME_BOUND(HG_MAX_BODY_BYTES)];
    struct hg_builder builder;

    hg_build_begin(&builder, wire, sizeof wire);
    hg_build_add(&builder, data, length);
    hex_print(wire, hg_build_end(&builder));
    printf("\n");
}

int main(int count, char **values)
{
    const char *mode = count > 1 ? values[1] : "0";

    while (fgets(text, sizeof text, stdin) != NULL) {
        size_t length = hex_read(data, sizeof data, text);

        if (strcmp(mode, "encode") == 0)
            encode(length);
        else
            decode(length, strtoul(mode, NULL, 10));
        printf(".\n");
    }
    return 0;
}
