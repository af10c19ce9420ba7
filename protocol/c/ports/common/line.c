/* Rings between the interrupts of the UART and the main loop. */

#include "line.h"

#include "../../board/limits.h"
#include "../../board/mute_watch.h"
#include "chip.h"
#include "clock.h"
#include "cortex_m.h"
#include "transducers.h"

enum { RECEIVED = BOARD_RX_WINDOW, STAMPS = 64, SENDING = 512 }; /* powers of two */

HG_STATIC_ASSERT((RECEIVED & (RECEIVED - 1)) == 0, rx_window_is_a_power_of_two);

/* The byte before `end` is a delimiter and arrived at `ticks`. */
struct stamp {
    uint32_t end, ticks;
};

static uint8_t received[RECEIVED];
static volatile uint32_t arrived, taken;
static struct stamp stamps[STAMPS];
static volatile uint32_t stamped, stamps_taken;
static struct mute_watch watch;
static volatile uint32_t muted_end;
static volatile uint8_t muted;
static uint8_t sending[SENDING];
static volatile uint32_t queued, sent;

static void ordered(void) { __asm volatile("" ::: "memory"); }

/* --- Receive ----------------------------------------------------------------------------------- */

static void stamp(uint32_t ticks)
{
    if (stamped - stamps_taken == STAMPS)
        return; /* the main loop is far behind: it takes its own time for these bytes */
    stamps[stamped % STAMPS].end = arrived;
    stamps[stamped % STAMPS].ticks = ticks;
    ordered();
    stamped++;
}

void line_received(uint8_t byte, uint32_t ticks)
{
    if (arrived - taken == RECEIVED)
        return; /* more than rx_window: lost, as its CRC will tell */
    received[arrived % RECEIVED] = byte;
    ordered();
    arrived++;
    if (byte == 0)
        stamp(ticks);
    if (mute_watch_take(&watch, byte)) {
        transducers_shut();
        muted_end = arrived;
        muted = 1;
    }
}

/* Return the next delimiter's stamp, or NULL. */
static const struct stamp *next_stamp(void)
{
    while (stamps_taken != stamped) {
        const struct stamp *next = &stamps[stamps_taken % STAMPS];

        if ((int32_t)(next->end - taken) > 0)
            return next;
        stamps_taken++;
    }
    return NULL;
}

size_t line_take(const uint8_t **data, int64_t *t_us)
{
    const struct stamp *next = next_stamp();
    uint32_t length = (next != NULL ? next->end : arrived) - taken;
    uint32_t to_the_end = RECEIVED - taken % RECEIVED;

    ordered();
    *data = received + taken % RECEIVED;
    *t_us = next != NULL ? clock_of_us(next->ticks) : clock_now_us();
    return length < to_the_end ? length : to_the_end;
}

void line_taken(size_t length)
{
    ordered();
    taken += (uint32_t)length;
    interrupts_off();
    if (muted && (int32_t)(taken - muted_end) >= 0) {
        muted = 0;
        transducers_unmute();
    }
    interrupts_on();
}

int line_is_muted(void) { return muted; }

size_t line_until_unmuted(void) { return muted ? muted_end - taken : 0; }

int line_has_received(void) { return arrived != taken; }

/* --- Send -------------------------------------------------------------------------------------- */

int line_next_byte(uint8_t *byte)
{
    if (sent == queued)
        return 0;
    *byte = sending[sent % SENDING];
    ordered();
    sent++;
    return 1;
}

int line_has_room(void) { return queued - sent < SENDING; }

size_t line_send(const uint8_t *data, size_t length)
{
    size_t i;

    for (i = 0; i < length && line_has_room(); i++) {
        sending[queued % SENDING] = data[i];
        ordered();
        queued++;
    }
    if (queued != sent)
        chip_transmit();
    return i;
}

size_t line_waiting(void) { return queued - sent; }
