/* Uploads: announced, sent in chunks, taken whole or not at all.  SPEC.md HG-7.2 to HG-7.4.

   The only part that allocates: a board with less memory advertises less and keeps one arena. */

#include "uploads.h"

#include <stdlib.h>

#include "link.h"

void upload_abandon(struct board *board)
{
    free(board->upload.data);
    memset(&board->upload, 0, sizeof board->upload);
}

/* Return the sequence with this id, or NULL; the id 0 gives a free place. */
struct sequence *upload_find(struct board *board, uint16_t id)
{
    size_t i;

    for (i = 0; i < BOARD_SEQUENCES; i++)
        if (board->sequences[i].id == id)
            return &board->sequences[i];
    return NULL;
}

uint32_t upload_stored(const struct board *board)
{
    uint32_t total = 0;
    size_t i;

    for (i = 0; i < BOARD_SEQUENCES; i++)
        if (board->sequences[i].id != 0)
            total += board->sequences[i].frame_bytes * board->sequences[i].frames;
    return total;
}

static int is_playing(const struct board *board, uint16_t target)
{
    return board->playback.sequence != NULL && board->playback.sequence->id == target;
}

/* --- Begin ------------------------------------------------------------------------------------ */

static uint32_t frame_bytes(const struct board *board, const struct hg_upload_begin *begin)
{
    if (begin->kind == HG_UPLOAD_POINTS)
        return begin->points_per_frame * HG_SIZE_FOCAL_POINT;
    return board->count;
}

static int points_fit(const struct hg_upload_begin *begin)
{
    if (begin->kind != HG_UPLOAD_POINTS)
        return begin->points_per_frame == 0;
    return begin->points_per_frame >= 1 && begin->points_per_frame <= BOARD_MAX_POINTS;
}

/* Return the bytes that a new sequence of this id may have. */
static uint32_t room(struct board *board, uint16_t target)
{
    const struct sequence *old = target == 0 ? NULL : upload_find(board, target);
    uint32_t others = upload_stored(board) - (old ? old->frame_bytes * old->frames : 0);

    if (target != 0 && old == NULL && upload_find(board, 0) == NULL)
        return 0;
    return BOARD_STORED_BYTES - others;
}

/* Return 0, or the code of the refusal. */
static uint8_t refusal(struct board *board, const struct hg_upload_begin *begin, uint32_t *detail)
{
    uint32_t bytes = frame_bytes(board, begin);
    uint32_t most = begin->kind == HG_UPLOAD_CORRECTION ? 1 : BOARD_SEQUENCE_FRAMES;

    *detail = HG_OFFSET_UPLOAD_BEGIN_POINTS_PER_FRAME;
    if (!points_fit(begin))
        return HG_ERROR_BAD_VALUE;
    *detail = HG_OFFSET_UPLOAD_BEGIN_TARGET;
    if ((begin->target == 0) != (begin->kind == HG_UPLOAD_CORRECTION))
        return HG_ERROR_BAD_VALUE;
    *detail = BOARD_UPLOAD_BYTES;
    if (begin->size > BOARD_UPLOAD_BYTES)
        return HG_ERROR_TOO_LARGE;
    *detail = bytes;
    if (begin->size == 0 || begin->size % bytes != 0)
        return HG_ERROR_BAD_LENGTH;
    *detail = most;
    if (begin->size / bytes > most)
        return HG_ERROR_TOO_LARGE;
    *detail = room(board, begin->target);
    return begin->size > *detail ? HG_ERROR_TOO_LARGE : 0;
}

void upload_begin(struct board *board, const struct request *request)
{
    static const uint8_t offer[HG_SIZE_UPLOAD_BEGIN_REPLY] = {
        BOARD_CHUNK_BYTES & 0xFF, BOARD_CHUNK_BYTES >> 8,
        BOARD_UPLOAD_WINDOW & 0xFF, BOARD_UPLOAD_WINDOW >> 8,
    };
    struct hg_upload_begin begin;
    uint32_t detail = board->state;
    uint8_t code = HG_ERROR_BAD_STATE;
    uint8_t *data;

    hg_upload_begin_read(&begin, request->payload);
    if (!is_playing(board, begin.target))
        code = refusal(board, &begin, &detail);
    if (code != 0) {
        link_refuse(board, request, code, detail);
        return;
    }
    data = calloc(begin.size, 1);
    if (data == NULL) {
        link_refuse(board, request, HG_ERROR_TOO_LARGE, 0);
        return;
    }
    upload_abandon(board);
    board->upload.begun = 1;
    board->upload.begin = begin;
    board->upload.frame_bytes = frame_bytes(board, &begin);
    board->upload.data = data;
    link_reply(board, request, offer, sizeof offer);
}

/* --- Chunks ----------------------------------------------------------------------------------- */

static uint32_t received(const struct upload *upload)
{
    if (upload->range_count == 0 || upload->ranges[0].start != 0)
        return 0;
    return upload->ranges[0].stop;
}

/* Add a range; join it with the ranges that it touches. */
static void add_range(struct upload *upload, struct range fresh)
{
    struct range kept[BOARD_RANGES + 2];
    size_t count = 0;
    int placed = 0;
    size_t i;

    for (i = 0; i < upload->range_count; i++) {
        struct range old = upload->ranges[i];

        if (old.stop >= fresh.start && old.start <= fresh.stop) {
            fresh.start = old.start < fresh.start ? old.start : fresh.start;
            fresh.stop = old.stop > fresh.stop ? old.stop : fresh.stop;
            continue;
        }
        if (!placed && old.start > fresh.stop) {
            kept[count++] = fresh;
            placed = 1;
        }
        kept[count++] = old;
    }
    if (!placed)
        kept[count++] = fresh;
    memcpy(upload->ranges, kept, count * sizeof kept[0]);
    upload->range_count = count;
}

void upload_chunk(struct board *board, const struct request *request)
{
    struct upload *upload = &board->upload;
    uint32_t offset = hg_get_u32(request->payload);
    uint32_t length = (uint32_t)(request->length - HG_SIZE_UPLOAD_CHUNK);
    uint8_t payload[HG_SIZE_UPLOAD_CHUNK_REPLY];
    struct range fresh;

    if (!upload->begun) {
        link_refuse(board, request, HG_ERROR_BAD_STATE, board->state);
    } else if (length > BOARD_CHUNK_BYTES) {
        link_refuse(board, request, HG_ERROR_BAD_LENGTH, BOARD_CHUNK_BYTES);
    } else if ((uint64_t)offset + length > upload->begin.size) {
        link_refuse(board, request, HG_ERROR_BAD_VALUE, HG_OFFSET_UPLOAD_CHUNK_OFFSET);
    } else if (upload->range_count > BOARD_RANGES) {
        link_refuse(board, request, HG_ERROR_BUSY, 0);
    } else {
        memcpy(upload->data + offset, request->payload + HG_SIZE_UPLOAD_CHUNK, length);
        fresh.start = offset;
        fresh.stop = offset + length;
        if (length > 0)
            add_range(upload, fresh);
        hg_put_u32(payload, received(upload));
        link_reply(board, request, payload, sizeof payload);
    }
}

/* --- Commit ----------------------------------------------------------------------------------- */

static void put_in_force(struct board *board)
{
    struct upload *upload = &board->upload;
    struct sequence *sequence;

    if (upload->begin.kind == HG_UPLOAD_CORRECTION) {
        memcpy(board->correction, upload->data, board->count);
        return;
    }
    sequence = upload_find(board, upload->begin.target);
    if (sequence == NULL)
        sequence = upload_find(board, 0); /* UPLOAD_BEGIN found a free place */
    free(sequence->data);
    sequence->id = upload->begin.target;
    sequence->kind = upload->begin.kind;
    sequence->points = upload->begin.points_per_frame;
    sequence->frame_bytes = upload->frame_bytes;
    sequence->frames = upload->begin.size / upload->frame_bytes;
    sequence->data = upload->data;
    upload->data = NULL; /* the sequence owns the memory now */
}

void upload_commit(struct board *board, const struct request *request)
{
    struct upload *upload = &board->upload;
    uint16_t target = hg_get_u16(request->payload);
    uint8_t payload[HG_SIZE_UPLOAD_COMMIT_REPLY];
    uint32_t crc;

    if (is_playing(board, target) || !upload->begun) {
        link_refuse(board, request, HG_ERROR_BAD_STATE, board->state);
        return;
    }
    if (target != upload->begin.target) {
        link_refuse(board, request, HG_ERROR_BAD_VALUE, HG_OFFSET_UPLOAD_COMMIT_TARGET);
        return;
    }
    if (received(upload) < upload->begin.size) {
        link_refuse(board, request, HG_ERROR_INCOMPLETE, received(upload));
        return;
    }
    crc = hg_crc32(0, upload->data, upload->begin.size);
    if (crc != upload->begin.crc) {
        link_refuse(board, request, HG_ERROR_CRC_MISMATCH, crc);
        return;
    }
    hg_put_u32(payload, upload->begin.kind == HG_UPLOAD_CORRECTION
                            ? board->count
                            : upload->begin.size / upload->frame_bytes);
    put_in_force(board);
    upload_abandon(board);
    link_reply(board, request, payload, sizeof payload);
}
