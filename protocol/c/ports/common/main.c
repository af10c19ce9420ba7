/* The board on a microcontroller: one main loop, and the interrupts of a UART.

   The loop never waits but in wait_for_interrupt, and feeds the watchdog once a turn: if it hangs,
   the chip is reset, and a chip that is reset has its output off. */

#include "../../board/board.h"
#include "chip.h"
#include "clock.h"
#include "cortex_m.h"
#include "line.h"
#include "pin_trace.h"
#include "transducers.h"

#ifndef PORT_GRID_NX
#define PORT_GRID_NX 16
#define PORT_GRID_NY 16
#endif
#ifndef PORT_STORE_BYTES
#define PORT_STORE_BYTES 32768
#endif
/* 1: configuration and correction outlive a reset (CONFIG_KEPT). */
#ifndef PORT_KEEPS_CONFIG
#define PORT_KEEPS_CONFIG 0
#endif
/* Faults on purpose: to try interrupt and watchdog without a main loop, and a slow start. */
#ifndef PORT_HANGS_AFTER_LATCH
#define PORT_HANGS_AFTER_LATCH 0
#endif
/* 1: never sleeps, so that the emulator of `emulate --ns` counts instructions and no time of the host. */
#ifndef PORT_SPINS
#define PORT_SPINS 0
#endif
#ifndef PORT_DEAF_MS
#define PORT_DEAF_MS 0
#endif

HG_STATIC_ASSERT(PORT_GRID_NX * PORT_GRID_NY <= BOARD_ELEMENTS, grid_fits);

static struct board board;
static uint8_t store[PORT_STORE_BYTES];
/* Not cleared at a reset: a count of starts, from whatever the memory held at power-up. */
static uint32_t starts __attribute__((section(".noinit")));
/* Nor this: it outlives a reset, though no loss of power. */
static struct kept kept __attribute__((section(".noinit"), unused));

static uint32_t mixed(uint32_t number)
{
    number = (number ^ number >> 16) * 0x45D9F3Bu;
    number = (number ^ number >> 16) * 0x45D9F3Bu;
    return number ^ number >> 16;
}

/* A number for HG-4.3/5: what the memory held, the count of starts, and how the two clocks ran. */
static uint32_t boot_id(void)
{
    uint32_t number = mixed(++starts);
    int i;

    SYST_RVR = 0xFFFFFFu;
    SYST_CSR = 5;
    for (i = 0; i < 64; i++)
        number = mixed(number ^ SYST_CVR ^ chip_ticks() << 24);
    SYST_CSR = 0;
    return number;
}

static int64_t departure_us(void *context, size_t waiting_bytes)
{
    (void)context;
    int64_t waiting = (int64_t)(waiting_bytes + line_waiting()) * 1000000;

    return clock_now_us() + (CHIP_LINE_BYTES_PER_S > 0 ? waiting / CHIP_LINE_BYTES_PER_S : 0);
}

static void start_board(void)
{
    static const struct machine machine = {
        .store = store,
        .store_bytes = PORT_STORE_BYTES,
        .kept = PORT_KEEPS_CONFIG ? &kept : NULL,
        .line_bytes_per_s = CHIP_LINE_BYTES_PER_S,
        .radiate = transducers_radiate,
        .load = transducers_load,
        .departure_us = departure_us,
    };
    struct array array = {PORT_GRID_NX, PORT_GRID_NY, 10000, 0};

    array.boot_id = boot_id();
    board_start(&board, &array, &machine);
}

static uint32_t wait_us(int64_t until_us)
{
    const uint32_t longest_us = CHIP_WATCHDOG_MS * 1000u / 4;
    int64_t wait_us = until_us - clock_now_us();

    if (wait_us > longest_us)
        wait_us = longest_us;
    return wait_us < 0 ? 0 : (uint32_t)wait_us;
}

/* Take a frame, at the time of its arrival, or let time pass if none waits: the board lives in the
   order of arrivals and events, however late this loop is.  A MUTE that waits overtakes it. */
static void turn(void)
{
    const uint8_t *data;
    int64_t t_us;
    size_t length = line_take(&data, &t_us);

    if (length == 0) {
        board_advance(&board, clock_now_us());
        return;
    }
    board_mute_ahead(&board, line_until_unmuted());
    board_receive(&board, data, length, t_us);
    line_taken(length);
}

static void send(void)
{
    size_t length;
    const uint8_t *output = board_output(&board, &length);

    board_sent(&board, line_send(output, length));
}

/* Return 1 if only an interrupt or time brings something to do; interrupts are off. */
static int is_idle(void)
{
    size_t waiting;

    board_output(&board, &waiting);
    return !line_has_received() && (waiting == 0 || !line_has_room());
}

/* Sleep until something arrives, is sent or is due.  The alarm comes no later than that of the drive
   that is loaded, and sets it anew: the next turn may compute for as long as it likes. */
static void sleep(void)
{
    int64_t event_us = board_next_event(&board), strobe_us = transducers_strobe_us();
    uint32_t after_us = wait_us(strobe_us < event_us ? strobe_us : event_us);

    if (PORT_SPINS || after_us < 2)
        return;
    interrupts_off();
    set_alarm(after_us);
    if (is_idle())
        wait_for_interrupt();
    interrupts_on();
}

static void stay_deaf(void)
{
    const uint32_t counted = 1u << 16;
    int ms;

    SYST_RVR = CHIP_CORE_MHZ * 1000u - 1;
    SYST_CSR = 5;
    for (ms = 0; ms < PORT_DEAF_MS; ms++)
        while ((SYST_CSR & counted) == 0)
            ;
    SYST_CSR = 0;
}

int main(void)
{
    stay_deaf();
    chip_start();
    start_board();
    interrupts_on();
    chip_watchdog_start();
    for (;;) {
        chip_watchdog_feed();
        turn();
        send();
        pin_trace_again();
        sleep();
        while (PORT_HANGS_AFTER_LATCH && board.has_latched)
            ;
    }
}
