/* Codes in two sets of registers, and the pin that gates the transducers. */

#include "transducers.h"

#include "../../board/limits.h"
#include "chip.h"
#include "clock.h"
#include "cortex_m.h"
#include "line.h"
#include "pin_trace.h"

HG_STATIC_ASSERT((int64_t)BOARD_AHEAD_US * CHIP_TICKS_PER_US <= INT32_MAX, ticks_order_strobes);

/* Registers of drivers that have a second set of them.  A board with driver chips or an FPGA loads
   those instead, and pulses their latch line where `active` changes. */
static volatile struct drive registers[2];
static volatile uint8_t active; /* the set that drives */
static volatile int wanted;     /* 1: the board radiates */

/* The set that is not active, once it is loaded; the timer interrupt makes it active. */
static struct {
    volatile int loaded, waits;
    volatile int wanted_before; /* whether the board radiated when it was taken */
    int64_t due_us;
    uint32_t strobe_ticks; /* drivers take a set at the beginning of the carrier period after this */
    volatile uint32_t taken_ticks;
} next;

static void load(const struct drive *drive)
{
    volatile struct drive *set = &registers[1 - active];
    size_t n;

    for (n = 0; n < BOARD_ELEMENTS; n++) {
        set->phase[n] = drive->phase[n];
        set->amplitude[n] = drive->amplitude[n];
    }
}

/* Interrupts are off, or this is one. */
static void set_gate(int is_open, uint32_t ticks)
{
    chip_enable_output(is_open);
    pin_trace(is_open, ticks, &registers[active]);
}

void transducers_shut(void) { set_gate(0, chip_ticks()); }

/* Interrupts are off, or this is one. */
static void take(void)
{
    active = 1 - active;
    next.waits = 0;
    next.taken_ticks = CHIP_MEASURES_LATCH ? chip_ticks() : next.strobe_ticks;
    next.wanted_before = wanted;
    wanted = 1;
    set_gate(!line_is_muted(), next.taken_ticks);
}

/* What was taken for a latch that does not come, as of a playback that STOP ended, goes back. */
static void drop_next(void)
{
    interrupts_off();
    if (next.loaded && !next.waits) {
        active = 1 - active;
        wanted = next.wanted_before;
        set_gate(wanted && !line_is_muted(), chip_ticks());
    }
    next.loaded = next.waits = 0;
    interrupts_on();
}

static uint32_t strobe_ticks(int64_t due_us)
{
    return clock_ticks_of(due_us - BOARD_CARRIER_US + 1);
}

void transducers_load(void *context, const struct drive *radiated, int64_t due_us)
{
    (void)context;
    drop_next();
    if (radiated == NULL)
        return;
    load(radiated);
    next.due_us = due_us;
    next.strobe_ticks = strobe_ticks(due_us);
    interrupts_off();
    next.loaded = next.waits = 1;
    transducers_tick();
    interrupts_on();
}

void transducers_tick(void)
{
    int32_t left = (int32_t)(next.strobe_ticks - chip_ticks());

    if (next.waits && left <= 0)
        take();
    else if (next.waits)
        set_alarm(((uint32_t)left + CHIP_TICKS_PER_US - 1) / CHIP_TICKS_PER_US);
}

int64_t transducers_strobe_us(void)
{
    return next.waits ? next.due_us - BOARD_CARRIER_US + 1 : BOARD_NEVER;
}

/* Drivers take their registers at the beginning of a carrier period (HG-5.8/2). */
static int64_t effect_us(int64_t due_us)
{
    int64_t taken_us;

    if (!CHIP_MEASURES_LATCH)
        return due_us;
    taken_us = clock_of_us(next.taken_ticks);
    return (taken_us + BOARD_CARRIER_US - 1) / BOARD_CARRIER_US * BOARD_CARRIER_US;
}

void transducers_unmute(void) { set_gate(wanted, chip_ticks()); }

int64_t transducers_radiate(void *context, const struct drive *radiated, int64_t due_us)
{
    (void)context;
    if (radiated == NULL) {
        interrupts_off();
        next.loaded = next.waits = wanted = 0;
        set_gate(0, chip_ticks());
        interrupts_on();
        return due_us;
    }
    if (!next.loaded || next.due_us != due_us) { /* a step of a ramp, or a drive that is late */
        drop_next();
        load(radiated);
        next.strobe_ticks = strobe_ticks(due_us);
        next.waits = 1;
    }
    interrupts_off();
    if (next.waits)
        take();
    next.loaded = 0;
    interrupts_on();
    return effect_us(due_us);
}
