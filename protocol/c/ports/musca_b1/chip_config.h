/* Arm Musca-B1, Cortex-M33 in the secure world, as QEMU's musca-b1: 40 MHz, UART0. */

#ifndef PORT_CHIP_CONFIG_H
#define PORT_CHIP_CONFIG_H

#define CHIP_CORE_MHZ 40
#define CHIP_TICKS_PER_US 40
#define CHIP_LINE_BYTES_PER_S 0
#define CHIP_MEASURES_LATCH 0
#define CHIP_WATCHDOG_MS 1900 /* within the 2 s of HG-6.12/1 */

#endif
