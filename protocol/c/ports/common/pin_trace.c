/* What the transducers get, told to an emulator by semihosting. */

#include "pin_trace.h"

#include "chip.h"
#include "cortex_m.h"

enum { SYS_OPEN = 1, SYS_WRITE = 5, SYS_GET_CMDLINE = 21, MODE_WRITE_BINARY = 5 };

struct record {
    uint32_t ticks;
    uint16_t ticks_per_us, is_open;
};

static uintptr_t semihosting(uintptr_t operation, uintptr_t *arguments)
{
    register uintptr_t r0 __asm("r0") = operation;
    register uintptr_t *r1 __asm("r1") = arguments;

    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

/* Open the file that the command line of the emulator names. */
static uintptr_t open_file(void)
{
    static char name[1024];
    uintptr_t line[] = {(uintptr_t)name, sizeof name};

    semihosting(SYS_GET_CMDLINE, line);
    return semihosting(SYS_OPEN, (uintptr_t[]){line[0], MODE_WRITE_BINARY, line[1]});
}

static void write(const volatile void *data, size_t length)
{
    static uintptr_t file;

    if (file == 0)
        file = open_file();
    semihosting(SYS_WRITE, (uintptr_t[]){file, (uintptr_t)data, length});
}

static struct {
    int is_open;
    uint32_t ticks;
    const volatile struct drive *driving;
} newest;

void pin_trace(int is_open, uint32_t ticks, const volatile struct drive *driving)
{
    if (PORT_TRACES_PINS) {
        struct record record = {ticks, CHIP_TICKS_PER_US, (uint16_t)is_open};

        newest.is_open = is_open;
        newest.ticks = ticks;
        newest.driving = driving;
        write(&record, sizeof record);
        write(driving, sizeof *driving);
    }
}

void pin_trace_again(void)
{
    const int32_t longest = PIN_TRACE_LONGEST_S * 1000000 * CHIP_TICKS_PER_US;

    if (!PORT_TRACES_PINS)
        return;
    interrupts_off();
    if (newest.driving != NULL && (int32_t)(chip_ticks() - newest.ticks) > longest)
        pin_trace(newest.is_open, chip_ticks(), newest.driving);
    interrupts_on();
}
