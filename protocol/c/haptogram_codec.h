/* A portable codec of the Haptogram wire protocol: COBS, CRC-32, parser, frame builder.  C99.

   The codec allocates nothing and calls only memcpy and memset.  The parser keeps at most
   HG_MAX_ENCODED_BYTES of any input; the builder never writes beyond its buffer. */

#ifndef HAPTOGRAM_CODEC_H
#define HAPTOGRAM_CODEC_H

#include <stddef.h>
#include <stdint.h>

#include "haptogram_messages.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Every check returns this, or the counter (enum hg_counter) of the fault. */
#define HG_OK (-1)

/* Most bytes of `length` bytes in COBS, and of the frame around such a body. */
#define HG_COBS_BOUND(length) ((length) + (length) / 254u + 1u)
#define HG_FRAME_BOUND(body) (HG_COBS_BOUND((body) + HG_CRC_BYTES) + 2u)

/* --- Bytes (SPEC.md chapter 2) ---------------------------------------------------------------- */

/* CRC-32/ISO-HDLC of `data`, continuing `crc` of the bytes before (0: none). */
uint32_t hg_crc32(uint32_t crc, const uint8_t *data, size_t length);

/* Stuff `from` into `to`, which has room for HG_COBS_BOUND(length) bytes; return their number. */
size_t hg_cobs_encode(uint8_t *to, const uint8_t *from, size_t length);

/* Decode in place and set `*decoded`; HG_COUNTER_COBS if a code points past the end. */
int hg_cobs_decode(uint8_t *data, size_t length, size_t *decoded);

/* --- Frames out ------------------------------------------------------------------------------- */

/* COBS and CRC-32 are computed as the bytes come, so a frame needs no second buffer. */
struct hg_builder {
    uint8_t *to;
    size_t capacity;
    size_t length;
    size_t code_at; /* where the code byte of the open block goes */
    unsigned run;   /* bytes in the open block and its code; 0: no block is open */
    uint32_t crc;
    int overflow;
};

void hg_build_begin(struct hg_builder *builder, uint8_t *to, size_t capacity);
void hg_build_add(struct hg_builder *builder, const uint8_t *data, size_t length);

/* End the frame; return its length with both delimiters, or 0 if the buffer was too small. */
size_t hg_build_end(struct hg_builder *builder);

/* Build a whole frame of a header and one payload. */
size_t hg_build_frame(uint8_t *to, size_t capacity, const struct hg_header *header,
                      const uint8_t *payload, size_t length);

/* --- Frames in -------------------------------------------------------------------------------- */

enum hg_parsed {
    HG_PARSED_NOTHING, /* every byte was taken, no frame has ended */
    HG_PARSED_FRAME,   /* CRC right; the message itself is yet to be checked */
    HG_PARSED_DAMAGE   /* counted under `reason` */
};

/* Valid until the parser gets more bytes. */
struct hg_frame {
    struct hg_header header;
    const uint8_t *body; /* header and payload */
    size_t body_length;
    const uint8_t *payload;
    size_t payload_length;
    int reason; /* HG_COUNTER_CRC, _COBS, _SHORT or _OVERSIZE */
};

struct hg_parser {
    uint8_t buffer[HG_MAX_ENCODED_BYTES];
    size_t length;
    int discarding; /* 1: the run is too long; wait for the next delimiter */
};

void hg_parser_reset(struct hg_parser *parser);

/* Take bytes up to the end of the next frame; set `*taken`, which may be less than `length`. */
enum hg_parsed hg_parse(struct hg_parser *parser, const uint8_t *data, size_t length, size_t *taken,
                        struct hg_frame *frame);

/* --- Messages --------------------------------------------------------------------------------- */

/* Check type, length and enumerations: HG_OK, HG_COUNTER_UNKNOWN_TYPE, _BAD_LENGTH or _BAD_VALUE;
   `*offset` is the first byte of the wrong value in the payload. */
int hg_check_message(uint8_t type, const uint8_t *payload, size_t length, size_t *offset);

/* Bytes of the fixed part of a message, and the unit of its tail, 0 without one; 0 if unknown. */
int hg_message_layout(uint8_t type, size_t *fixed, size_t *unit);

#ifdef __cplusplus
}
#endif

#endif
