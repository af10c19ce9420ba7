/* Bytes over a raw pseudo-terminal to a child process, and an answer back.
   ping_pong BYTES_THERE BYTES_BACK TIMES [PERIOD_NS]: "ready", then every round trip as int64 in ns;
   with a period from each deadline to the moment at which the child has the last byte. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>
static int64_t now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}
static void raw(int fd) {
    struct termios t;
    tcgetattr(fd, &t);
    cfmakeraw(&t);
    tcsetattr(fd, TCSANOW, &t);
}
static int whole(int fd, char *at, int size) {
    for (int got = 0; got < size;) {
        int n = read(fd, at + got, size - got);
        if (n <= 0) return 0;
        got += n;
    }
    return 1;
}
int main(int argc, char **argv) {
    if (argc != 4 && argc != 5) return 2;
    int64_t period = argc == 5 ? atoll(argv[4]) : 0;
    int there = atoi(argv[1]), back = atoi(argv[2]), count = atoi(argv[3]);
    static char bytes[4096];
    int64_t *trip = calloc(count, sizeof *trip);
    int board = posix_openpt(O_RDWR | O_NOCTTY);
    if (!trip || there > 4096 || back > 4096 || back < 8) return 1;
    if (board < 0 || grantpt(board) || unlockpt(board)) return 1;
    int host = open(ptsname(board), O_RDWR | O_NOCTTY);
    if (host < 0) return 1;
    prctl(PR_SET_TIMERSLACK, 1UL, 0, 0, 0);
    raw(board);
    raw(host);
    int child = fork();
    if (!child) {
        while (whole(board, bytes, there)) {
            *(int64_t *)bytes = now();
            if (write(board, bytes, back) != back) break;
        }
        _exit(0);
    }
    int64_t deadline = now() + period;
    for (int i = 0; i < count; i++, deadline += period) {
        struct timespec t = {deadline / 1000000000LL, deadline % 1000000000LL};
        if (period) clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
        int64_t begin = period ? deadline : now();
        if (write(host, bytes, there) != there || !whole(host, bytes, back)) return 1;
        trip[i] = (period ? *(int64_t *)bytes : now()) - begin;
    }
    kill(child, SIGKILL);
    waitpid(child, NULL, 0);
    puts("ready");
    fflush(stdout);
    return fwrite(trip, sizeof *trip, count, stdout) != (size_t)count;
}
