// A Verilog board as a simulator for haptogram (docs/simulators.md), by Verilator.
//
// The model has a clock and a vector of pins, maybe a line to the board and one from it; their
// names, and the numbers, are given when this is compiled:
//   verilator --cc --exe --build -O3 --top-module board -CFLAGS '-O2 -DMODEL=Vboard -DCLK=clk
//     -DRX=rx -DPINS=pins -DCOUNT=16 -DHZ=32000000 -DPERIOD=25000 -DSTART=0' board.v verilator.cpp
// -DTX=tx for a board that answers. START: ns from power-up until it takes bytes.
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <deque>
#include <vector>
#include "verilated.h"
#define TEXT_OF(name) #name
#define TEXT(name) TEXT_OF(name)
#define HEADER_OF(name) TEXT_OF(name.h)
#define HEADER(name) HEADER_OF(name)
#include HEADER(MODEL)

typedef uint64_t u64;
static const u64 FS = 1000000;  // femtoseconds of a nanosecond: clocks are whole numbers of them
static const int WORDS = (COUNT + 31) / 32;
struct Byte { u64 begin; unsigned value; };

template <class T> static void read_pins(const T &pins, uint32_t *words) {
    for (int n = 0; n < WORDS; n++) words[n] = (uint32_t)((u64)pins >> 32 * n);
}
template <std::size_t N> static void read_pins(const VlWide<N> &pins, uint32_t *words) {
    memcpy(words, pins.data(), sizeof(uint32_t) * WORDS);
}

// The changes of this period, and of the last: the time of each, and all pins.
static std::vector<uint32_t> changes, last;
static u64 period = (u64)PERIOD * FS, same = 0;  // end of this period; those like the last, not told yet

static void tell_same() {
    if (same) printf("= %llu\n", (unsigned long long)same);
    same = 0;
}

static void tell_periods(u64 up_to) {
    for (; up_to >= period; period += (u64)PERIOD * FS, changes.clear()) {
        if (changes == last && ++same) continue;
        tell_same();
        for (size_t at = 0; at < changes.size(); at += 1 + WORDS) {
            printf("P %u ", changes[at]);
            for (int n = WORDS; n > 0; n--) printf("%0*x", n == WORDS ? (COUNT + 3) / 4 - 8 * n + 8 : 8, changes[at + n]);
            puts("");
        }
        puts("|");
        last = changes;
    }
}

int main() {
    MODEL *model = new MODEL;
    const u64 clock = 1000000000000000ull / HZ;
    u64 t = 0, bit = 0, until = 0, rising = 0;
    uint32_t pins[WORDS] = {0}, now[WORDS];
    std::deque<Byte> line;
    unsigned sending = 0, sent = 0;  // the bits that have come from the board, and which is next
    char text[80];
    model->CLK = 0;
    model->eval();
    while (fgets(text, sizeof text, stdin)) {
        char word;
        unsigned long long number;
        unsigned value = 0;
        if (sscanf(text, "%c %llu %x", &word, &number, &value) < 2) continue;
        if (word == 'L') {
            bit = number * FS;
            printf("hello 1\nby Verilator, " TEXT(MODEL) "\nperiod %d\nstart %d\npins", PERIOD, START);
            for (int n = 0; n < COUNT; n++) printf(" " TEXT(PINS) "%d", n);
            printf("\n. 0\n");
            fflush(stdout);
        }
        if (word == 'B') line.push_back({(u64)number * FS, value << 1 | 0x200});
        if (word != 'T') continue;
        bool stops = false;
        for (until = number * FS; t <= until && !stops; t += clock) {
#ifdef RX
            while (!line.empty() && t >= line.front().begin + 10 * bit) line.pop_front();
            bool talks = !line.empty() && t >= line.front().begin;
            model->RX = talks ? line.front().value >> (t - line.front().begin) / bit & 1 : 1;
#endif
            model->CLK = 1;
            model->eval();
            model->CLK = 0;
            model->eval();
            tell_periods(t);
            read_pins(model->PINS, now);
            if (memcmp(now, pins, sizeof pins)) {
                memcpy(pins, now, sizeof pins);
                changes.push_back((t + (u64)PERIOD * FS - period) / FS);
                changes.insert(changes.end(), pins, pins + WORDS);
            }
#ifdef TX
            if (!sending && !model->TX) rising = t + bit + bit / 2, sending = 9, sent = 0;
            else if (sending && t >= rising) {
                rising += bit;
                if (--sending) sent |= model->TX << (8 - sending);
                else stops = true, until = t;
            }
#endif
        }
        tell_periods(until);
        tell_same();
        if (stops) printf("R %llu %02x\n", (unsigned long long)(until / FS), sent);
        printf(". %llu\n", (unsigned long long)(until / FS));
        fflush(stdout);
    }
    return 0;
}
