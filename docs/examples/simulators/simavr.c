// An AVR as a simulator for haptogram (docs/simulators.md), by simavr.
//
//   gcc -O2 -o avr simavr.c -lsimavr
//   ./avr MCU HZ PERIOD START PORTS FIRMWARE     (./avr atmega328p 20480000 25000 1000000 B board.elf)
// PERIOD and START in ns: of the carrier, and from power-up until the board takes bytes. PORTS: BD
// has the pins PB0 to PB7, PD0 to PD7. The line is UART 0.
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

static avr_t *avr;
static const char *ports;
static uint64_t period_ns, period, same = 0, until = 0;  // end of this period; those like the last, not told
static double ns_per_clock;
static uint8_t levels[32];
static struct change { uint64_t since; uint8_t levels[32]; } *changes, *before;  // in this period, in the last
static size_t count = 0, counted = 0;  // changes in these
static int stops, sent;
static struct { uint64_t begin; uint8_t value; } line[65536];  // bytes that come; a ring
static uint16_t first, last;

static uint64_t now_ns(void) { return (uint64_t)(avr->cycle * ns_per_clock); }

static void tell_same(void) {
    if (same) printf("= %" PRIu64 "\n", same);
    same = 0;
}

static void tell_periods(uint64_t up_to) {
    for (; up_to >= period; period += period_ns, count = 0) {
        if (count == counted && !memcmp(changes, before, count * sizeof *changes) && ++same) continue;
        tell_same();
        for (size_t at = 0; at < count; at++) {
            printf("P %" PRIu64 " ", changes[at].since);
            for (int n = strlen(ports) - 1; n >= 0; n--) printf("%02x", changes[at].levels[n]);
            puts("");
        }
        puts("|");
        memcpy(before, changes, count * sizeof *changes);
        counted = count;
    }
}

static void on_port(struct avr_irq_t *irq, uint32_t value, void *port) {
    uint8_t *level = port;
    if (*level == (uint8_t)value) return;
    *level = value;
    tell_periods(now_ns());
    changes[count].since = now_ns() + period_ns - period;
    memcpy(changes[count++].levels, levels, sizeof levels);
}

static void on_byte(struct avr_irq_t *irq, uint32_t value, void *unused) {
    until = now_ns();
    sent = value;
    stops = 1;
}

static void quiet(avr_t *of, const int level, const char *format, va_list words) {
    if (level <= LOG_ERROR) vfprintf(stderr, format, words);
}

int main(int count, char **words) {
    elf_firmware_t firmware = {{0}};
    if (count != 7) return fprintf(stderr, "usage: %s MCU HZ PERIOD START PORTS FIRMWARE\n", words[0]), 2;
    avr_global_logger_set(quiet);
    avr = avr_make_mcu_by_name(words[1]);
    if (!avr || elf_read_firmware(words[6], &firmware)) return fprintf(stderr, "no such MCU or file\n"), 2;
    avr_init(avr);
    avr_load_firmware(avr, &firmware);
    avr->frequency = strtoul(words[2], 0, 10);
    ns_per_clock = 1e9 / avr->frequency;
    period = period_ns = strtoull(words[3], 0, 10);
    changes = calloc(2 * (period_ns / ns_per_clock + 3), sizeof *changes);  // one in a clock at most
    before = changes + (size_t)(period_ns / ns_per_clock) + 2;
    ports = words[5];
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_t *to_board = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_byte, 0);
    for (size_t n = 0; n < strlen(ports); n++)
        avr_irq_register_notify(
            avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(ports[n]), IOPORT_IRQ_REG_PORT), on_port, levels + n);
    char text[80], word;
    while (fgets(text, sizeof text, stdin)) {
        uint64_t number;
        unsigned value = 0;
        if (sscanf(text, "%c %" SCNu64 " %x", &word, &number, &value) < 2) continue;
        if (word == 'L') {
            printf("hello 1\nby simavr, %s\nperiod %" PRIu64 "\nstart %s\npins", words[1], period_ns, words[4]);
            for (size_t n = 0; n < 8 * strlen(ports); n++) printf(" P%c%zu", ports[n / 8], n % 8);
            puts("\n. 0");
        } else if (word == 'B') {
            line[last].begin = number;
            line[last++].value = value;
        } else if (word == 'T') {
            for (until = number, stops = 0; !stops && now_ns() < until;) {
                for (; first != last && now_ns() >= line[first].begin; first++) avr_raise_irq(to_board, line[first].value);
                if (avr_run(avr) == cpu_Crashed) return fprintf(stderr, "the AVR crashed\n"), 1;
            }
            tell_periods(until);
            tell_same();
            if (stops) printf("R %" PRIu64 " %02x\n", until, sent);
            printf(". %" PRIu64 "\n", until);
        }
        fflush(stdout);
    }
    return 0;
}
