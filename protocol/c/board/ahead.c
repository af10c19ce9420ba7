/* The next drive, handed to the machine before it is due.  SPEC.md HG-5.8. */

#include "ahead.h"

#include "output.h"
#include "playback.h"
#include "stream.h"

/* Return when the next latch is due, or BOARD_NEVER. */
static int64_t next_latch(const struct board *board, struct hg_latch_key *key)
{
    const struct entry *entry = stream_next(board);

    memset(key, 0, sizeof *key);
    if (entry != NULL) {
        key->index = entry->index;
        return entry->t_latch_us;
    }
    if (board->playback.sequence != NULL)
        playback_next(board, key);
    return playback_due_us(board);
}

static int is_loaded(const struct board *board, const struct hg_latch_key *key)
{
    const struct ahead *ahead = &board->ahead;

    return ahead->loaded && ahead->settings == board->settings
           && ahead->key.sequence == key->sequence && ahead->key.loop == key->loop
           && ahead->key.index == key->index;
}

static void load(struct board *board, int64_t due_us, const struct hg_latch_key *key)
{
    const struct entry *entry = stream_next(board);
    struct drive radiated;

    if (entry == NULL)
        playback_drive(board, &board->ahead.drive);
    output_shape(board, entry != NULL ? &entry->drive : &board->ahead.drive, &radiated);
    board->machine.load(board->machine.context, &radiated, due_us);
    board->ahead.loaded = 1;
    board->ahead.due_us = due_us;
    board->ahead.key = *key;
    board->ahead.settings = board->settings;
}

/* Return 1 if nothing but the host can change that latch: the output has not ended by then, and its
   amplitude follows no ramp.  A latch renews the hold, and not the lease. */
static int is_sure(const struct board *board, int64_t due_us)
{
    int64_t ramp_us = (int64_t)board->config.ramp_ms * 1000;
    int64_t last_us = board->ramp.running ? board->ramp.end_us - ramp_us : board->hold.deadline_us;

    return board->lease.deadline_us > due_us && last_us >= due_us - ramp_us;
}

void ahead_load(struct board *board)
{
    struct hg_latch_key key;
    int64_t due_us;

    if (board->machine.load == NULL)
        return;
    due_us = next_latch(board, &key);
    if (due_us == BOARD_NEVER || !is_sure(board, due_us)) {
        if (board->ahead.loaded)
            board->machine.load(board->machine.context, NULL, due_us);
        board->ahead.loaded = 0;
    } else if (!is_loaded(board, &key) || board->ahead.due_us != due_us) {
        load(board, due_us, &key);
    }
}

const struct drive *ahead_playback_drive(struct board *board)
{
    struct hg_latch_key key;

    playback_next(board, &key);
    if (!is_loaded(board, &key))
        playback_drive(board, &board->ahead.drive);
    return &board->ahead.drive;
}
