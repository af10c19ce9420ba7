/* A loop with absolute deadlines: clock_nanosleep to SPIN ns before each, then a spin.
   loop PERIOD_NS TICKS SPIN_NS: "ready", then at the end the lateness of every tick as int64 in ns. */
#define _GNU_SOURCE
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <time.h>
static int64_t now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}
int main(int argc, char **argv) {
    if (argc != 4) return 2;
    int64_t period = atoll(argv[1]), count = atoll(argv[2]), spin = atoll(argv[3]);
    int64_t *late = calloc(count, sizeof *late), n = 0;
    if (!late) return 1;
    for (int64_t i = 0; i < count; i++) late[i] = 1;  /* touch every page */
    prctl(PR_SET_TIMERSLACK, 1UL, 0, 0, 0);
    puts("ready");
    fflush(stdout);
    int64_t deadline = now() + period;
    for (; n < count; n++) {
        int64_t wake = deadline - spin;
        struct timespec t = {wake / 1000000000LL, wake % 1000000000LL};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
        int64_t is;
        while ((is = now()) < deadline) {}
        late[n] = is - deadline;
        deadline += period * ((is - deadline) / period + 1);
    }
    return fwrite(late, sizeof *late, n, stdout) != (size_t)n;
}
