#include "haptogram_codec.h"

#define FULL_BLOCK 0xFFu /* COBS code of 254 bytes that no zero follows */

/* --- CRC-32 ----------------------------------------------------------------------------------- */

uint32_t hg_crc32(uint32_t crc, const uint8_t *data, size_t length)
{
    /* Half a byte at a time: a table of 64 bytes suits the smallest board. */
    static const uint32_t table[16] = {
        0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u,
        0x4DB26158u, 0x5005713Cu, 0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu,
        0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu,
    };
    size_t i;

    crc = ~crc & 0xFFFFFFFFu;
    for (i = 0; i < length; i++) {
        crc ^= data[i];
        crc = (crc >> 4) ^ table[crc & 0x0Fu];
        crc = (crc >> 4) ^ table[crc & 0x0Fu];
    }
    return ~crc & 0xFFFFFFFFu;
}

/* --- COBS and the frame builder --------------------------------------------------------------- */

static void put(struct hg_builder *builder, uint8_t byte)
{
    if (builder->length < builder->capacity)
        builder->to[builder->length++] = byte;
    else
        builder->overflow = 1;
}

static void open_block(struct hg_builder *builder)
{
    builder->code_at = builder->length;
    builder->run = 1;
    put(builder, 0); /* replaced when the length of the block is known */
}

static void close_block(struct hg_builder *builder)
{
    if (!builder->overflow)
        builder->to[builder->code_at] = (uint8_t)builder->run;
    builder->run = 0;
}

/* After a full block a code byte follows only if another byte comes. */
static void stuff(struct hg_builder *builder, const uint8_t *data, size_t length)
{
    size_t i;

    for (i = 0; i < length; i++) {
        if (builder->run == 0)
            open_block(builder);
        if (data[i] == 0) {
            close_block(builder);
            open_block(builder);
            continue;
        }
        put(builder, data[i]);
        if (++builder->run == FULL_BLOCK)
            close_block(builder);
    }
}

static void begin_at(struct hg_builder *builder, uint8_t *to, size_t capacity)
{
    memset(builder, 0, sizeof *builder);
    builder->to = to;
    builder->capacity = capacity;
}

static void finish_stuffing(struct hg_builder *builder)
{
    if (builder->run != 0)
        close_block(builder);
}

size_t hg_cobs_encode(uint8_t *to, const uint8_t *from, size_t length)
{
    struct hg_builder builder;

    begin_at(&builder, to, HG_COBS_BOUND(length));
    stuff(&builder, from, length);
    if (length == 0)
        open_block(&builder);
    finish_stuffing(&builder);
    return builder.length;
}

int hg_cobs_decode(uint8_t *data, size_t length, size_t *decoded)
{
    size_t from = 0;
    size_t to = 0;
    int zero_due = 0; /* a block stands for its bytes and a zero, unless it is full or the last */

    while (from < length) {
        size_t code = data[from];
        if (code == 0 || from + code > length)
            return HG_COUNTER_COBS;
        if (zero_due)
            data[to++] = 0;
        zero_due = code != FULL_BLOCK;
        for (from++; code > 1; code--) /* `to` stays behind `from`: a code byte was skipped */
            data[to++] = data[from++];
    }
    *decoded = to;
    return HG_OK;
}

void hg_build_begin(struct hg_builder *builder, uint8_t *to, size_t capacity)
{
    begin_at(builder, to, capacity);
    put(builder, 0);
}

void hg_build_add(struct hg_builder *builder, const uint8_t *data, size_t length)
{
    builder->crc = hg_crc32(builder->crc, data, length);
    stuff(builder, data, length);
}

size_t hg_build_end(struct hg_builder *builder)
{
    uint8_t crc[HG_CRC_BYTES];

    hg_put_u32(crc, builder->crc);
    stuff(builder, crc, sizeof crc);
    finish_stuffing(builder);
    put(builder, 0);
    return builder->overflow ? 0 : builder->length;
}

size_t hg_build_frame(uint8_t *to, size_t capacity, const struct hg_header *header,
                      const uint8_t *payload, size_t length)
{
    struct hg_builder builder;
    uint8_t head[HG_HEADER_BYTES];

    hg_header_write(head, header);
    hg_build_begin(&builder, to, capacity);
    hg_build_add(&builder, head, sizeof head);
    hg_build_add(&builder, payload, length);
    return hg_build_end(&builder);
}

/* --- Parser ----------------------------------------------------------------------------------- */

void hg_parser_reset(struct hg_parser *parser)
{
    parser->length = 0;
    parser->discarding = 0;
}

/* The order of the checks is that of HG-3.8: COBS, length, CRC. */
static int decode(struct hg_parser *parser, struct hg_frame *frame)
{
    size_t length = 0;
    const uint8_t *body = parser->buffer;
    int reason = hg_cobs_decode(parser->buffer, parser->length, &length);

    parser->length = 0;
    if (reason != HG_OK)
        return reason;
    if (length < HG_HEADER_BYTES + HG_CRC_BYTES)
        return HG_COUNTER_SHORT;
    length -= HG_CRC_BYTES;
    if (hg_crc32(0, body, length) != hg_get_u32(body + length))
        return HG_COUNTER_CRC;
    hg_header_read(&frame->header, body);
    frame->body = body;
    frame->body_length = length;
    frame->payload = body + HG_HEADER_BYTES;
    frame->payload_length = length - HG_HEADER_BYTES;
    return HG_OK;
}

enum hg_parsed hg_parse(struct hg_parser *parser, const uint8_t *data, size_t length, size_t *taken,
                        struct hg_frame *frame)
{
    size_t i;

    for (i = 0; i < length; i++) {
        *taken = i + 1;
        if (data[i] == 0) {
            if (!parser->discarding && parser->length > 0) {
                frame->reason = decode(parser, frame);
                return frame->reason == HG_OK ? HG_PARSED_FRAME : HG_PARSED_DAMAGE;
            }
            parser->discarding = 0;
        } else if (!parser->discarding) {
            if (parser->length < HG_MAX_ENCODED_BYTES) {
                parser->buffer[parser->length++] = data[i];
                continue;
            }
            parser->length = 0;
            parser->discarding = 1;
            frame->reason = HG_COUNTER_OVERSIZE;
            return HG_PARSED_DAMAGE;
        }
    }
    *taken = length;
    return HG_PARSED_NOTHING;
}

/* --- Messages --------------------------------------------------------------------------------- */

struct layout {
    uint8_t type;
    uint16_t fixed;
    uint16_t unit;
    uint8_t least;
};

static const struct layout layouts[] = {
#define LAYOUT(name, type, fixed, unit, least) {type, fixed, unit, least},
    HG_MESSAGES(LAYOUT)
#undef LAYOUT
};

static const struct {
    uint8_t type;
    uint16_t offset;
    uint32_t mask;
} allowed[] = {
#define ALLOWED(name, offset, mask) {HG_TYPE_##name, offset, mask},
    HG_ALLOWED_VALUES(ALLOWED)
#undef ALLOWED
};

static const struct layout *find(uint8_t type)
{
    size_t i;

    for (i = 0; i < sizeof layouts / sizeof layouts[0]; i++)
        if (layouts[i].type == type)
            return &layouts[i];
    return NULL;
}

int hg_message_layout(uint8_t type, size_t *fixed, size_t *unit)
{
    const struct layout *layout = find(type);

    if (layout == NULL)
        return 0;
    *fixed = layout->fixed;
    *unit = layout->unit;
    return 1;
}

/* A later minor version may add to a response or event without a tail (HG-11.3). */
static int length_fits(const struct layout *layout, uint8_t type, size_t length)
{
    size_t rest;

    if (length < layout->fixed)
        return 0;
    rest = length - layout->fixed;
    if (layout->unit == 0)
        return rest == 0 || type >= 0x80;
    return rest % layout->unit == 0 && rest >= (size_t)layout->least * layout->unit;
}

int hg_check_message(uint8_t type, const uint8_t *payload, size_t length, size_t *offset)
{
    const struct layout *layout = find(type);
    size_t i;

    *offset = 0;
    if (layout == NULL)
        return HG_COUNTER_UNKNOWN_TYPE;
    if (!length_fits(layout, type, length))
        return HG_COUNTER_BAD_LENGTH;
    for (i = 0; i < sizeof allowed / sizeof allowed[0]; i++) {
        if (allowed[i].type != type)
            continue;
        *offset = allowed[i].offset;
        if (payload[*offset] > 31 || (allowed[i].mask >> payload[*offset] & 1u) == 0)
            return HG_COUNTER_BAD_VALUE;
    }
    *offset = 0;
    return HG_OK;
}
