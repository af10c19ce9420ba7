/* A board in C99 on a pseudo-terminal: the whole protocol, no transducers.

   reference_board [--link PATH] [--grid NXxNY] [--pitch-um N] [--boot-id N] [--keep FILE]

   The first line of its output is `listening on PATH`, without --link `listening on /dev/pts/N`.
   With --keep, configuration and correction are in FILE, and outlive the process (CONFIG_KEPT).
   SIGUSR1 is a hardware fault. */

#define _XOPEN_SOURCE 700 /* pseudo-terminals, CLOCK_MONOTONIC, sigaction */

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "board/board.h"
#include "board/mute_watch.h"

enum { USAGE = 2, CHUNK = 4096, LONGEST_WAIT_MS = 1000, STORE_BYTES = 96 << 20 };

static volatile sig_atomic_t ended;
static volatile sig_atomic_t faulty;

static void on_end(int number)
{
    (void)number;
    ended = 1;
}

static void on_fault(int number)
{
    (void)number;
    faulty = 1;
}

static void die(const char *what)
{
    fprintf(stderr, "reference_board: %s: %s\n", what, strerror(errno));
    exit(USAGE);
}

static void usage(const char *option, const char *value, const char *demand)
{
    fprintf(stderr,
            "reference_board: %s%s%s: %s\n"
            "usage: reference_board [--link PATH] [--grid NXxNY] [--pitch-um N] [--boot-id N] "
            "[--keep FILE]\n",
            option, value != NULL ? " " : "", value != NULL ? value : "", demand);
    exit(USAGE);
}

/* --- Command line ----------------------------------------------------------------------------- */

struct options {
    struct array array;
    const char *link;
    const char *keep;
};

/* Return 1 if the text begins with a whole number within the limits. */
static int number(const char *text, uint32_t low, uint32_t high, uint32_t *value, char **end)
{
    unsigned long read;

    errno = 0;
    read = strtoul(text, end, 10);
    *value = (uint32_t)read;
    return *text >= '0' && *text <= '9' && errno == 0 && read >= low && read <= high;
}

static uint32_t whole_number(const char *option, const char *text, uint32_t low, uint32_t high,
                             const char *demand)
{
    uint32_t value;
    char *end;

    if (!number(text, low, high, &value, &end) || *end != '\0')
        usage(option, text, demand);
    return value;
}

static void take_grid(struct array *array, const char *text)
{
    uint32_t nx = 0, ny = 0;
    char *end;

    if (!number(text, 1, HG_MAX_TRANSDUCERS, &nx, &end) || *end != 'x'
        || !number(end + 1, 1, HG_MAX_TRANSDUCERS, &ny, &end) || *end != '\0'
        || nx * ny > HG_MAX_TRANSDUCERS)
        usage("--grid", text, "takes NXxNY, as in 16x16, at most 1024 transducers");
    array->nx = (uint16_t)nx;
    array->ny = (uint16_t)ny;
}

static struct options take_options(int count, char **values)
{
    struct options options = {{16, 16, 10000, 0}, NULL, NULL};
    int i;

    options.array.boot_id = (uint32_t)time(NULL) ^ (uint32_t)getpid() << 16;
    for (i = 1; i < count; i += 2) {
        const char *value = i + 1 < count ? values[i + 1] : NULL;

        if (value == NULL)
            usage(values[i], NULL, "the option takes a value");
        else if (strcmp(values[i], "--link") == 0)
            options.link = value;
        else if (strcmp(values[i], "--keep") == 0)
            options.keep = value;
        else if (strcmp(values[i], "--grid") == 0)
            take_grid(&options.array, value);
        else if (strcmp(values[i], "--pitch-um") == 0)
            options.array.pitch_um = whole_number(
                values[i], value, 1, 1000000, "takes a whole number of micrometres, 1 to 1000000");
        else if (strcmp(values[i], "--boot-id") == 0)
            options.array.boot_id = whole_number(
                values[i], value, 0, 0xFFFFFFFFu, "takes a whole number, 0 to 4294967295");
        else
            usage(values[i], value, "unknown option");
    }
    return options;
}

/* --- Line ------------------------------------------------------------------------------------- */

struct line {
    int master;
    int slave; /* kept open, so that the line outlives its hosts */
    char name[256];
};

/* No echo, no line discipline: every byte goes through unchanged (HG-2.7/1). */
static void make_raw(int terminal)
{
    struct termios settings;

    if (tcgetattr(terminal, &settings) != 0)
        die("terminal settings");
    settings.c_iflag = 0;
    settings.c_oflag = 0;
    settings.c_lflag = 0;
    settings.c_cflag = (settings.c_cflag & ~(tcflag_t)(CSIZE | PARENB)) | CS8 | CREAD | CLOCAL;
    settings.c_cc[VMIN] = 1;
    settings.c_cc[VTIME] = 0;
    if (tcsetattr(terminal, TCSANOW, &settings) != 0)
        die("terminal settings");
}

static void open_line(struct line *line)
{
    const char *name;

    line->master = posix_openpt(O_RDWR | O_NOCTTY);
    if (line->master < 0 || grantpt(line->master) != 0 || unlockpt(line->master) != 0)
        die("pseudo-terminal");
    name = ptsname(line->master);
    if (name == NULL || strlen(name) >= sizeof line->name)
        die("name of the pseudo-terminal");
    strcpy(line->name, name);
    line->slave = open(line->name, O_RDWR | O_NOCTTY);
    if (line->slave < 0)
        die(line->name);
    make_raw(line->slave);
    if (fcntl(line->master, F_SETFL, O_NONBLOCK) != 0)
        die("pseudo-terminal");
}

/* Replace a link that an earlier board left behind, and nothing else. */
static void make_link(const char *path, const char *target)
{
    char old[8];

    if (readlink(path, old, sizeof old) >= 0 && unlink(path) != 0)
        die(path);
    if (symlink(target, path) != 0)
        die(path);
}

/* --- Memory that outlives the board ------------------------------------------------------------- */

static struct kept *open_kept(const char *path)
{
    int file = open(path, O_RDWR | O_CREAT, 0666);
    void *memory = MAP_FAILED;

    if (file >= 0 && ftruncate(file, sizeof(struct kept)) == 0)
        memory = mmap(NULL, sizeof(struct kept), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (memory == MAP_FAILED)
        die(path);
    close(file);
    return memory;
}

/* --- Time ------------------------------------------------------------------------------------- */

static int64_t monotonic_us(void)
{
    struct timespec now;

    if (clock_gettime(CLOCK_MONOTONIC, &now) != 0)
        die("clock");
    return (int64_t)now.tv_sec * 1000000 + now.tv_nsec / 1000;
}

static int wait_ms(const struct board *board, int64_t now_us)
{
    int64_t next_us = board_next_event(board);

    if (next_us == BOARD_NEVER || next_us - now_us > LONGEST_WAIT_MS * 1000)
        return LONGEST_WAIT_MS;
    return next_us <= now_us ? 0 : (int)((next_us - now_us + 999) / 1000);
}

/* --- Work ------------------------------------------------------------------------------------- */

static int would_block(void)
{
    return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
}

static void write_output(struct board *board, int master)
{
    size_t length;
    const uint8_t *output = board_output(board, &length);
    ssize_t sent = write(master, output, length);

    if (sent < 0 && !would_block())
        die("write");
    board_sent(board, sent > 0 ? (size_t)sent : 0);
}

static void read_input(struct board *board, int master, int64_t origin_us)
{
    static struct mute_watch watch;
    uint8_t data[CHUNK];
    ssize_t i, length = read(master, data, sizeof data);

    if (length < 0 && !would_block())
        die("read");
    if (length <= 0)
        return;
    for (i = 0; i < length; i++)
        if (mute_watch_take(&watch, data[i]))
            board_mute_ahead(board, (size_t)i + 1); /* as an interrupt finds it, before the frames ahead of it */
    board_receive(board, data, (size_t)length, monotonic_us() - origin_us);
}

static void serve(struct board *board, int master)
{
    int64_t origin_us = monotonic_us() - BOARD_BOOT_US;

    while (!ended) {
        struct pollfd port = {master, POLLIN, 0};
        int ready;

        if (board->output_length > 0)
            port.events |= POLLOUT;
        ready = poll(&port, 1, wait_ms(board, monotonic_us() - origin_us));
        if (ready < 0 && errno != EINTR)
            die("poll");
        board_advance(board, monotonic_us() - origin_us);
        if (faulty) {
            faulty = 0;
            board_raise_hardware_fault(board);
        }
        if (ready > 0 && (port.revents & POLLIN))
            read_input(board, master, origin_us);
        if (board->output_length > 0)
            write_output(board, master);
    }
}

static void catch_signal(int which, void (*handler)(int))
{
    struct sigaction action;

    memset(&action, 0, sizeof action);
    action.sa_handler = handler;
    if (sigaction(which, &action, NULL) != 0)
        die("signal");
}

int main(int count, char **values)
{
    struct options options = take_options(count, values);
    struct machine machine = {.store = malloc(STORE_BYTES), .store_bytes = STORE_BYTES};
    struct board *board = malloc(sizeof *board);
    struct line line;

    if (board == NULL || machine.store == NULL)
        die("memory");
    catch_signal(SIGINT, on_end);
    catch_signal(SIGTERM, on_end);
    catch_signal(SIGUSR1, on_fault);
    if (options.keep != NULL)
        machine.kept = open_kept(options.keep);
    open_line(&line);
    if (options.link != NULL)
        make_link(options.link, line.name);
    board_start(board, &options.array, &machine);
    printf("listening on %s\n", options.link != NULL ? options.link : line.name);
    fflush(stdout);
    serve(board, line.master);
    if (options.link != NULL)
        unlink(options.link);
    free(board);
    free(machine.store);
    close(line.slave);
    close(line.master);
    return 0;
}
