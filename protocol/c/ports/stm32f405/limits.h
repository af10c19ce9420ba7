/* Limits of 256 transducers in 128 KiB. */

#define BOARD_ELEMENTS 256
#define BOARD_QUEUE 32
#define BOARD_RING 256
#define BOARD_SEQUENCES 16
#define BOARD_SEQUENCE_FRAMES 4096
#define BOARD_UPLOAD_WINDOW 2
#define BOARD_RX_WINDOW 16384
#define BOARD_OUTPUT 12288

/* Reckoned from instructions that the emulator counts (docs/firmware.md), at 1.5 cycles of 168 MHz each
   and a quarter more for the line: no real chip has shown them yet. */
#if !defined(EMULATED) || defined(CHIP_MEASURES_LATCH)
#ifndef BOARD_LATCH_LEAD_US
#define BOARD_LATCH_LEAD_US 500
#endif
#ifndef BOARD_POINT_TIME_US
#define BOARD_POINT_TIME_US 600
#endif
#endif
