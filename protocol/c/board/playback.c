/* Sequences on the board's clock.  SPEC.md HG-7.6 to HG-7.8. */

#include "playback.h"

#include "link.h"
#include "output.h"
#include "points.h"
#include "stream.h"
#include "uploads.h"

/* Return the offset of the first value that is wrong. */
static uint32_t bad_value(const struct board *board, const struct hg_play *play, size_t points,
                          int64_t start_us, int *is_bad)
{
    *is_bad = 1;
    if ((uint64_t)play->period_us * BOARD_PLAYBACK_HZ < 1000000u
        || play->period_us < points * BOARD_POINT_TIME_US)
        return HG_OFFSET_PLAY_PERIOD_US;
    if (play->unattended_ms == 0 || play->unattended_ms > BOARD_UNATTENDED_MS)
        return HG_OFFSET_PLAY_UNATTENDED_MS;
    *is_bad = start_us < stream_ready_us(board, points)
              || start_us - board->now_us > BOARD_HORIZON_US;
    return 0; /* offset of the start time, which is in the header */
}

static uint32_t stored_sequences(const struct board *board)
{
    uint32_t count = 0;
    size_t i;

    for (i = 0; i < BOARD_SEQUENCES; i++)
        count += board->sequences[i].id != 0;
    return count;
}

void playback_play(struct board *board, const struct request *request)
{
    struct playback *playback = &board->playback;
    const struct sequence *sequence;
    struct hg_play play;
    int immediate = (request->header.flags & HG_FLAG_IMMEDIATE) != 0;
    int32_t ahead_us = hg_ahead_u32(request->header.time_us, (uint32_t)board->now_us);
    int64_t start_us;
    uint32_t offset;
    size_t points;
    int is_bad;

    hg_play_read(&play, request->payload);
    if (board->state != HG_STATE_ARMED || playback->sequence != NULL) {
        link_refuse(board, request, HG_ERROR_BAD_STATE, board->state);
        return;
    }
    sequence = play.sequence == 0 ? NULL : upload_find(board, play.sequence);
    if (sequence == NULL) {
        link_refuse(board, request, HG_ERROR_NOT_FOUND, stored_sequences(board));
        return;
    }
    points = sequence->kind == HG_UPLOAD_POINTS ? sequence->points : 0;
    start_us = immediate ? stream_ready_us(board, points) : board->now_us + ahead_us;
    offset = bad_value(board, &play, points, start_us, &is_bad);
    if (is_bad) {
        link_refuse(board, request, HG_ERROR_BAD_VALUE, offset);
        return;
    }
    stream_flush(board);
    playback->sequence = sequence;
    playback->start_us = start_us;
    playback->period_us = play.period_us;
    playback->loops = play.loops;
    playback->unattended_ms = play.unattended_ms;
    playback->played = 0;
    output_renew_lease(board);
    link_reply(board, request, &board->state, HG_SIZE_PLAY_REPLY);
}

/* End the playback without an event; return 0 if nothing played. */
int playback_clear(struct board *board, struct hg_playback_ended *ended)
{
    struct playback *playback = &board->playback;

    if (playback->sequence == NULL)
        return 0;
    ended->sequence = playback->sequence->id;
    ended->loops = (uint32_t)(playback->played / playback->sequence->frames);
    ended->frames = (uint32_t)playback->played;
    playback->sequence = NULL;
    return 1;
}

void playback_send_ended(struct board *board, const struct hg_playback_ended *ended)
{
    uint8_t payload[HG_SIZE_PLAYBACK_ENDED];

    hg_playback_ended_write(payload, ended);
    link_event(board, HG_TYPE_PLAYBACK_ENDED, payload, sizeof payload, board->now_us, 0, OTHER);
}

void playback_end(struct board *board)
{
    struct hg_playback_ended ended;

    if (playback_clear(board, &ended))
        playback_send_ended(board, &ended);
}

/* After the playback the host timeout counts again. */
void playback_stop(struct board *board)
{
    if (board->playback.sequence == NULL)
        return;
    playback_end(board);
    output_renew_lease(board);
}

int64_t playback_due_us(const struct board *board)
{
    const struct playback *playback = &board->playback;

    if (playback->sequence == NULL)
        return BOARD_NEVER;
    return output_boundary_us(board, playback->start_us
                                         + (int64_t)playback->played * playback->period_us);
}

static void take_drive(const struct board *board, const struct sequence *sequence, uint32_t index,
                       struct drive *drive)
{
    const uint8_t *frame = upload_frame(board, sequence, index);

    if (sequence->kind == HG_UPLOAD_POINTS) {
        points_drive(board, frame, sequence->points, drive);
        return;
    }
    memcpy(drive->phase, frame, board->count);
    memset(drive->amplitude, 255, board->count);
}

void playback_next(const struct board *board, struct hg_latch_key *key)
{
    const struct playback *playback = &board->playback;

    key->sequence = playback->sequence->id;
    key->loop = (uint32_t)(playback->played / playback->sequence->frames);
    key->index = (uint32_t)(playback->played % playback->sequence->frames);
}

void playback_drive(const struct board *board, struct drive *drive)
{
    struct hg_latch_key key;

    playback_next(board, &key);
    take_drive(board, board->playback.sequence, key.index, drive);
}

void playback_latch(struct board *board, const struct drive *drive)
{
    struct playback *playback = &board->playback;
    const struct sequence *sequence = playback->sequence;
    struct hg_latch_key key;

    playback_next(board, &key);
    output_latch(board, &key, drive, 0);
    playback->played++;
    if (playback->loops > 0 && playback->played >= (uint64_t)playback->loops * sequence->frames)
        playback_stop(board);
}
