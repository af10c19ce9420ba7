/* The drives of a port on this computer: one step for each line of standard input.

   at TIME           the chip's time, in microseconds since it started; alarms come on the way
   load TIME CODE    the board loads the phase CODE for TIME
   unload            what was loaded is not to be taken
   radiate TIME CODE the board latches it
   off               the board ends the output

   After each step the phase that the transducers get, or "-" while their gate is shut. */

#include <stdint.h>
#include <stdio.h>
#include <string.h>

#define PORT_CORTEX_M_H /* this computer has no interrupts to mask */
static void interrupts_off(void) {}
static void interrupts_on(void) {}
static void set_alarm(uint32_t after_us);

#include "../ports/common/clock.c"
#include "../ports/common/transducers.c"

enum { LONGEST_ALARM_US = 99864 }; /* 24 bits at 168 MHz */

static uint32_t now_us, alarm_us;
static int is_open, has_alarm;

uint32_t chip_ticks(void) { return now_us * CHIP_TICKS_PER_US; }
void chip_enable_output(int enabled) { is_open = enabled; }
int line_is_muted(void) { return 0; }
void pin_trace(int gate, uint32_t ticks, const volatile struct drive *drive)
{
    (void)gate, (void)ticks, (void)drive;
}

static void set_alarm(uint32_t after_us)
{
    alarm_us = now_us + (after_us < LONGEST_ALARM_US ? after_us : LONGEST_ALARM_US);
    has_alarm = 1;
}

static void wait_until(uint32_t us)
{
    while (has_alarm && alarm_us <= us) {
        now_us = alarm_us;
        has_alarm = 0;
        transducers_tick();
    }
    now_us = us;
}

int main(void)
{
    static struct drive drive;
    char text[64], word[8];

    while (fgets(text, sizeof text, stdin) != NULL) {
        unsigned us = 0, code = 0;

        if (sscanf(text, "%7s %u %u", word, &us, &code) < 1)
            return 2;
        memset(drive.phase, (int)code, sizeof drive.phase);
        if (strcmp(word, "at") == 0) {
            wait_until(us);
        } else if (strcmp(word, "load") == 0) {
            transducers_load(NULL, &drive, BOARD_BOOT_US + us);
        } else if (strcmp(word, "unload") == 0) {
            transducers_load(NULL, NULL, BOARD_NEVER);
        } else {
            transducers_radiate(NULL, strcmp(word, "off") == 0 ? NULL : &drive, BOARD_BOOT_US + us);
        }
        if (is_open)
            printf("%d\n", registers[active].phase[0]);
        else
            printf("-\n");
    }
    return 0;
}
