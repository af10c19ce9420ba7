/* Limits of 256 transducers in 128 KiB. */

#define BOARD_ELEMENTS 256
#define BOARD_QUEUE 32
#define BOARD_RING 256
#define BOARD_SEQUENCES 16
#define BOARD_SEQUENCE_FRAMES 4096
#define BOARD_UPLOAD_WINDOW 2
#define BOARD_RX_WINDOW 16384
#define BOARD_OUTPUT 12288

#ifndef EMULATED /* at 168 MHz, by the count of instructions: no real chip has shown them yet */
#define BOARD_LATCH_LEAD_US 500
#define BOARD_POINT_TIME_US 300
#endif
