/* The board in virtual time: one step for each line of standard input.

   rx TIME HEX   bytes whose last one is complete TIME microseconds after power-up
   held TIME HEX the same, but nobody reads yet what the board sends
   at TIME       let everything happen up to then
   until TIME    the same, but stop as soon as the board sends something
   fault TIME    a hardware fault
   mute TIME N   an interrupt has found a MUTE, the last of N bytes that come with a later rx
   reset         power down and up again

   After each step the bytes that the board sent, in hex, on a line of their own ("-": none); after
   `until` the time precedes them.

   board_steps [NXxNY [LATE_US [RATE [STORE [keep]]]]]: the grid, 16x16 unless told.  With LATE_US a machine whose
   drives take effect so much later, and each line goes on with what it radiated: time due, phase and
   amplitude of transducer 0 ("off": none), "ahead" if the board had loaded that drive before.  RATE: bytes a second of its line; STORE: bytes for
   sequences; `keep`: configuration and correction outlive a reset.  LATE_US -1: no transducers. */

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "../board/board.h"
#include "hex.h"

enum { LINE = 1 << 17, STORE_BYTES = 96 << 20 };

static char text[LINE];
static uint8_t data[LINE / 2];

/* Go from event to event until the board sends something, at most up to t_us. */
static void advance_until_sent(struct board *board, int64_t t_us)
{
    while (board->output_length == 0 && board->now_us < t_us) {
        int64_t next_us = board_next_event(board);

        board_advance(board, next_us < t_us ? next_us : t_us);
    }
    printf("%" PRId64 " ", board->now_us - BOARD_BOOT_US);
}

static struct kept kept;
static struct drive loaded;
static int64_t loaded_us;
static int64_t hardware_us; /* how far the time of the hardware is ahead of a board that is late */

static void load(void *context, const struct drive *drive, int64_t due_us)
{
    (void)context;
    loaded_us = drive != NULL ? due_us : 0;
    if (drive != NULL)
        loaded = *drive;
}

/* What the hardware takes by itself has to be what the board wants then. */
static const char *taken(const struct drive *drive, int64_t due_us)
{
    if (loaded_us > due_us || loaded_us == 0)
        return "";
    if (loaded_us < due_us || memcmp(&loaded, drive, sizeof loaded) != 0) {
        fprintf(stderr, "another drive was loaded for %" PRId64 "\n", loaded_us - BOARD_BOOT_US);
        exit(1);
    }
    loaded_us = 0;
    return ":ahead";
}

static char radiated[LINE];
static size_t radiated_length;

static int64_t radiate(void *late_us, const struct drive *drive, int64_t due_us)
{
    char *to = radiated + radiated_length;
    size_t room = sizeof radiated - radiated_length;
    int length;

    if (drive == NULL)
        length = snprintf(to, room, " %" PRId64 ":off", due_us - BOARD_BOOT_US);
    else
        length = snprintf(to, room, " %" PRId64 ":%d:%d%s", due_us - BOARD_BOOT_US,
                          drive->phase[0], drive->amplitude[0], taken(drive, due_us));
    if (drive == NULL && loaded_us != 0 && loaded_us <= hardware_us) {
        fprintf(stderr, "a drive was taken at %" PRId64 ", after the end\n", loaded_us - BOARD_BOOT_US);
        exit(1);
    }
    if (drive == NULL)
        loaded_us = 0;
    if (length > 0 && (size_t)length < room)
        radiated_length += (size_t)length;
    return due_us + *(const int64_t *)late_us;
}

static void step(struct board *board, const char *word, int64_t t_us, const char *hex)
{
    const uint8_t *output;
    size_t length;

    hardware_us = strcmp(word, "until") == 0 ? 0 : BOARD_BOOT_US + t_us;
    if (strcmp(word, "reset") == 0) {
        struct array array = board->array;
        struct machine machine = board->machine;

        array.boot_id++; /* HG-4.3/5 */
        loaded_us = 0;
        board_start(board, &array, &machine);
    } else if (strcmp(word, "rx") == 0 || strcmp(word, "held") == 0) {
        board_receive(board, data, hex_read(data, sizeof data, hex), BOARD_BOOT_US + t_us);
    } else if (strcmp(word, "until") == 0) {
        advance_until_sent(board, BOARD_BOOT_US + t_us);
    } else {
        board_advance(board, BOARD_BOOT_US + t_us);
        if (strcmp(word, "fault") == 0)
            board_raise_hardware_fault(board);
        else if (strcmp(word, "mute") == 0)
            board_mute_ahead(board, strtoul(hex, NULL, 10));
    }
    output = board_output(board, &length);
    if (strcmp(word, "held") == 0)
        length = 0;
    hex_print(output, length);
    printf("%.*s\n", (int)radiated_length, radiated);
    fflush(stdout);
    radiated_length = 0;
    board_sent(board, length);
}

int main(int count, char **values)
{
    struct array array = {16, 16, 10000, 1};
    struct machine machine = {.store = malloc(STORE_BYTES), .store_bytes = STORE_BYTES};
    struct board *board = malloc(sizeof *board);
    int64_t late_us;
    unsigned nx, ny;

    if (board == NULL || machine.store == NULL)
        return 2;
    if (count > 1 && sscanf(values[1], "%ux%u", &nx, &ny) == 2 && nx * ny <= HG_MAX_TRANSDUCERS) {
        array.nx = (uint16_t)nx;
        array.ny = (uint16_t)ny;
    }
    if (count > 2 && sscanf(values[2], "%" SCNd64, &late_us) == 1 && late_us >= 0) {
        machine.context = &late_us;
        machine.radiate = radiate;
        machine.load = load;
    }
    if (count > 3)
        machine.line_bytes_per_s = (uint32_t)strtoul(values[3], NULL, 10);
    if (count > 4)
        machine.store_bytes = (uint32_t)strtoul(values[4], NULL, 10) % (STORE_BYTES + 1);
    if (count > 5 && strcmp(values[5], "keep") == 0)
        machine.kept = &kept;
    board_start(board, &array, &machine);
    while (fgets(text, sizeof text, stdin) != NULL) {
        char word[8] = "";
        int64_t t_us = 0;
        int hex = 0;

        sscanf(text, "%7s %" SCNd64 " %n", word, &t_us, &hex);
        step(board, word, t_us, text + hex);
    }
    free(board);
    free(machine.store);
    return 0;
}
