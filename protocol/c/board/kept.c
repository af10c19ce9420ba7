/* Configuration and correction in memory that outlives a reset.  SPEC.md HG-7.1/4. */

#include "kept.h"

#include "readout.h"

/* Memory that nobody wrote, half written or written by firmware with another layout has another. */
static uint32_t sealed(const struct board *board)
{
    return readout_config_crc(board) ^ (HG_VERSION_MAJOR << 8 | HG_VERSION_MINOR);
}

void kept_take(struct board *board)
{
    const struct kept *kept = board->machine.kept;
    struct hg_config defaults = board->config;

    if (kept == NULL)
        return;
    hg_config_read(&board->config, kept->config);
    memcpy(board->correction, kept->correction, board->count);
    if (kept->seal == sealed(board))
        return;
    board->config = defaults;
    memset(board->correction, 0, board->count);
}

void kept_give(struct board *board)
{
    struct kept *kept = board->machine.kept;

    if (kept == NULL || board->given == board->settings)
        return;
    hg_config_write(kept->config, &board->config);
    memcpy(kept->correction, board->correction, board->count);
    kept->seal = sealed(board);
    board->given = board->settings;
}
