/* Uploads: announced, sent in chunks, taken whole or not at all.  SPEC.md HG-7.2 to HG-7.4.

   The store holds the sequences one behind the other, then the upload that is under way. */

#include "uploads.h"

#include "link.h"

void upload_abandon(struct board *board)
{
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

uint32_t upload_limit(const struct board *board, uint32_t taken_bytes)
{
    uint32_t left = board->machine.store_bytes - taken_bytes;

    return left < BOARD_UPLOAD_BYTES ? left : BOARD_UPLOAD_BYTES;
}

const uint8_t *upload_frame(const struct board *board, const struct sequence *sequence,
                            uint32_t index)
{
    return board->machine.store + sequence->at + index * sequence->frame_bytes;
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

/* Return the bytes that an upload may have now: until its commit the old sequence stays. */
static uint32_t room(struct board *board, uint16_t target)
{
    if (target != 0 && upload_find(board, target) == NULL && upload_find(board, 0) == NULL)
        return 0;
    return upload_limit(board, board->stored);
}

/* Return 0, or the code of the refusal. */
static uint8_t refusal(struct board *board, const struct hg_upload_begin *begin, uint32_t *detail)
{
    uint32_t bytes = frame_bytes(board, begin);

    *detail = HG_OFFSET_UPLOAD_BEGIN_POINTS_PER_FRAME;
    if (!points_fit(begin))
        return HG_ERROR_BAD_VALUE;
    *detail = HG_OFFSET_UPLOAD_BEGIN_TARGET;
    if ((begin->target == 0) != (begin->kind == HG_UPLOAD_CORRECTION))
        return HG_ERROR_BAD_VALUE;
    *detail = bytes;
    if (begin->size == 0 || begin->size % bytes != 0
        || (begin->kind == HG_UPLOAD_CORRECTION && begin->size != bytes))
        return HG_ERROR_BAD_LENGTH;
    *detail = room(board, begin->target);
    if (begin->size > *detail)
        return HG_ERROR_TOO_LARGE;
    *detail = BOARD_SEQUENCE_FRAMES;
    return begin->size / bytes > *detail ? HG_ERROR_TOO_LARGE : 0;
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

    hg_upload_begin_read(&begin, request->payload);
    if (!is_playing(board, begin.target))
        code = refusal(board, &begin, &detail);
    if (code != 0) {
        link_refuse(board, request, code, detail);
        return;
    }
    board->upload.begun = 1;
    board->upload.begin = begin;
    board->upload.frame_bytes = frame_bytes(board, &begin);
    board->upload.at = board->stored;
    board->upload.received = 0;
    link_reply(board, request, offer, sizeof offer);
}

/* --- Chunks ----------------------------------------------------------------------------------- */

void upload_chunk(struct board *board, const struct request *request)
{
    struct upload *upload = &board->upload;
    uint32_t offset = hg_get_u32(request->payload);
    uint32_t length = (uint32_t)(request->length - HG_SIZE_UPLOAD_CHUNK);
    uint8_t payload[HG_SIZE_UPLOAD_CHUNK_REPLY];

    if (!upload->begun) {
        link_refuse(board, request, HG_ERROR_BAD_STATE, board->state);
    } else if (length > BOARD_CHUNK_BYTES) {
        link_refuse(board, request, HG_ERROR_BAD_LENGTH, BOARD_CHUNK_BYTES);
    } else if ((uint64_t)offset + length > upload->begin.size) {
        link_refuse(board, request, HG_ERROR_BAD_VALUE, HG_OFFSET_UPLOAD_CHUNK_OFFSET);
    } else if (offset > upload->received) {
        link_refuse(board, request, HG_ERROR_INCOMPLETE, upload->received);
    } else {
        memcpy(board->machine.store + upload->at + offset, request->payload + HG_SIZE_UPLOAD_CHUNK,
               length);
        if (offset + length > upload->received)
            upload->received = offset + length;
        hg_put_u32(payload, upload->received);
        link_reply(board, request, payload, sizeof payload);
    }
}

/* --- Commit ----------------------------------------------------------------------------------- */

/* Take a sequence out of the store; what lies behind it, the upload too, moves down. */
static void remove_sequence(struct board *board, struct sequence *old)
{
    uint32_t bytes = old->frame_bytes * old->frames;
    uint8_t *place = board->machine.store + old->at;
    size_t i;

    memmove(place, place + bytes, board->upload.at + board->upload.begin.size - old->at - bytes);
    for (i = 0; i < BOARD_SEQUENCES; i++)
        if (board->sequences[i].id != 0 && board->sequences[i].at > old->at)
            board->sequences[i].at -= bytes;
    board->upload.at -= bytes;
    board->stored -= bytes;
    old->id = 0;
}

static void put_in_force(struct board *board)
{
    const struct upload *upload = &board->upload;
    struct sequence *sequence;

    if (upload->begin.kind == HG_UPLOAD_CORRECTION) {
        memcpy(board->correction, board->machine.store + upload->at, board->count);
        board->settings++;
        return;
    }
    sequence = upload_find(board, upload->begin.target);
    if (sequence != NULL)
        remove_sequence(board, sequence);
    else
        sequence = upload_find(board, 0); /* UPLOAD_BEGIN found a free place */
    sequence->id = upload->begin.target;
    sequence->kind = upload->begin.kind;
    sequence->points = upload->begin.points_per_frame;
    sequence->frame_bytes = upload->frame_bytes;
    sequence->frames = upload->begin.size / upload->frame_bytes;
    sequence->at = upload->at;
    board->stored += upload->begin.size;
}

void upload_commit(struct board *board, const struct request *request)
{
    struct upload *upload = &board->upload;
    uint16_t target = hg_get_u16(request->payload);
    uint8_t payload[HG_SIZE_UPLOAD_COMMIT_REPLY];
    uint32_t crc;

    if (upload->begun && target != upload->begin.target) {
        link_refuse(board, request, HG_ERROR_BAD_VALUE, HG_OFFSET_UPLOAD_COMMIT_TARGET);
        return;
    }
    if (!upload->begun || is_playing(board, target)) {
        link_refuse(board, request, HG_ERROR_BAD_STATE, board->state);
        return;
    }
    if (upload->received < upload->begin.size) {
        link_refuse(board, request, HG_ERROR_INCOMPLETE, upload->received);
        return;
    }
    crc = hg_crc32(0, board->machine.store + upload->at, upload->begin.size);
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
