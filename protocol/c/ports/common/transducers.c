/* Codes in registers, and the pin that gates them. */

#include "transducers.h"

#include "chip.h"
#include "clock.h"
#include "cortex_m.h"
#include "line.h"

/* Registers of a driver.  A board with driver chips or an FPGA loads those instead: the time from
   here to their latch is what CHIP_MEASURES_LATCH shows to the host. */
static volatile struct drive registers;
static int wanted;

static void load(const struct drive *drive)
{
    size_t n;

    for (n = 0; n < BOARD_ELEMENTS; n++) {
        registers.phase[n] = drive->phase[n];
        registers.amplitude[n] = drive->amplitude[n];
    }
}

/* Drivers take their registers at the beginning of a carrier period (HG-5.8/2): a drive that is due
   now takes effect one period later at the soonest. */
static int64_t effect_us(int64_t due_us)
{
    int64_t loaded_us;

    if (!CHIP_MEASURES_LATCH)
        return due_us;
    loaded_us = clock_now_us();
    return (loaded_us + BOARD_CARRIER_US - 1) / BOARD_CARRIER_US * BOARD_CARRIER_US;
}

void transducers_unmute(void) { chip_enable_output(wanted); }

int64_t transducers_radiate(void *context, const struct drive *radiated, int64_t due_us)
{
    (void)context;
    wanted = radiated != NULL;
    if (!wanted) {
        chip_enable_output(0);
        return due_us;
    }
    load(radiated);
    interrupts_off(); /* or a MUTE between the question and the pin would be undone */
    chip_enable_output(!line_is_muted());
    interrupts_on();
    return effect_us(due_us);
}
