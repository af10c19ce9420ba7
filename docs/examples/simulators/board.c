// SonicSurface's wire on an ATmega328P at 20.48 MHz: 8 channels on port B, 32 steps of 40 kHz.
//
// FEh begins a frame of 256 codes (0 to 31: step of the rising edge, 32: off), of which the first 8
// count; FDh shows them. A step is 16 clocks. Every clock of the carrier is counted, and a byte is
// taken in one step of each period. The pins stand still for a period before a new frame.
//   avr-gcc -O2 -mmcu=atmega328p -DF_CPU=20480000 -o board.elf board.c
#include <avr/io.h>

static uint8_t codes[512] __attribute__((aligned(256)));  // two buffers
static uint8_t levels[32];

// Radiate until FDh; bytes go to the page of codes.
static void radiate(uint8_t *page) {
    asm volatile(
        ".macro slot spare\n ld r18, X+\n out %[port], r18\n"
        " .rept \\spare / 2\n rjmp .+0\n .endr\n .if \\spare & 1\n nop\n .endif\n .endm\n"
        "1: movw r26, %[levels]\n"
        ".rept 29\n slot 13\n .endr\n"
        "slot 0\n"  // a byte, if there is one
        " lds r18, %[status]\n sbrs r18, 7\n rjmp 2f\n"
        " lds r19, %[data]\n cpi r19, 0xFD\n breq 4f\n st Z, r19\n inc r30\n rjmp 3f\n"
        "2: rjmp .+0\n rjmp .+0\n rjmp .+0\n rjmp .+0\n"
        "3: slot 9\n"  // FEh: the next code is that of channel 0
        " cpi r19, 0xFE\n brne 5f\n ldi r30, 0\n5: ldi r19, 0\n"
        "slot 10\n rjmp 1b\n"
        "4: .purgem slot\n"
        : "+z"(page)
        : [levels] "r"(levels), [port] "I"(_SFR_IO_ADDR(PORTB)), [status] "n"(&UCSR0A), [data] "n"(&UDR0)
        : "r18", "r19", "r26", "r27", "memory");
}

// Make the levels of a period from codes, in little more than a period: the pins stand still.
static void show(const uint8_t *page) {
    static uint8_t edges[32];
    uint8_t level = 0;
    for (uint8_t channel = 1; channel; channel <<= 1) {
        uint8_t code = *page++;
        if (code == 32) continue;
        edges[code & 31] ^= channel;
        edges[(code + 16) & 31] ^= channel;
        if (code & 16) level |= channel;
    }
    for (uint8_t step = 0; step < 32; step++) {
        levels[step] = level ^= edges[step];
        edges[step] = 0;
    }
}

int main(void) {
    uint8_t written = 1;
    DDRB = 0xFF;
    UCSR0A = 1 << U2X0;
    UBRR0 = 10;  // 232 727 baud
    UCSR0B = 1 << RXEN0;
    show(codes);
    for (;;) {
        radiate(codes + 256 * written);
        show(codes + 256 * written);
        written ^= 1;
    }
}
