/* 64 bits of time from a timer of 32. */

#include "clock.h"

#include "../../board/limits.h"
#include "chip.h"

static uint32_t newest;
static int64_t elapsed_ticks;

static int64_t device_us(int64_t ticks) { return BOARD_BOOT_US + ticks / CHIP_TICKS_PER_US; }

int64_t clock_now_us(void)
{
    uint32_t ticks = chip_ticks();

    elapsed_ticks += (uint32_t)(ticks - newest);
    newest = ticks;
    return device_us(elapsed_ticks);
}

/* Device time t is reached when the elapsed ticks are (t - boot) * rate. */
uint32_t clock_ticks_of(int64_t t_us)
{
    clock_now_us();
    return newest + (uint32_t)((t_us - BOARD_BOOT_US) * CHIP_TICKS_PER_US - elapsed_ticks);
}

int64_t clock_of_us(uint32_t ticks)
{
    clock_now_us();
    return device_us(elapsed_ticks - (uint32_t)(newest - ticks));
}
