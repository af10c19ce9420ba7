/* MUTE among the bytes as they arrive: COBS and CRC-32, byte by byte. */

#include "mute_watch.h"

#include <string.h>

#include "limits.h"

#define CRC_OF_FRAME_AND_ITS_CRC 0x2144DF1Cu

static void take_decoded(struct mute_watch *watch, uint8_t byte)
{
    if (watch->decoded == 0 && byte != HG_TYPE_MUTE)
        watch->is_other = 1;
    else
        watch->crc = hg_crc32(watch->crc, &byte, 1);
    watch->decoded++;
}

static int is_mute(const struct mute_watch *watch)
{
    return !watch->is_other && watch->left == 0
           && watch->decoded >= HG_HEADER_BYTES + HG_CRC_BYTES
           && watch->crc == CRC_OF_FRAME_AND_ITS_CRC;
}

int mute_watch_take(struct mute_watch *watch, uint8_t byte)
{
    if (byte == 0) {
        int found = is_mute(watch);

        memset(watch, 0, sizeof *watch);
        return found;
    }
    if (watch->is_other)
        return 0;
    if (watch->encoded++ == HG_MAX_ENCODED_BYTES) {
        watch->is_other = 1; /* HG-2.6/3 */
    } else if (watch->left > 0) {
        watch->left--;
        take_decoded(watch, byte);
    } else {
        if (watch->encoded > 1 && !watch->full)
            take_decoded(watch, 0);
        watch->left = (uint8_t)(byte - 1);
        watch->full = byte == 0xFF;
    }
    return 0;
}
