/* Bytes between the interrupts of the UART and the main loop.

   Who writes what, and how the other side is kept from reading half of it:

   | state                        | written by  | guard                                          |
   | ---------------------------- | ----------- | ---------------------------------------------- |
   | received bytes, their count  | interrupt   | the count is one word, written after the byte  |
   | count of bytes taken         | main loop   | one word, written after the bytes were used    |
   | times of delimiters          | the same as of the received bytes                            |
   | watch for MUTE               | interrupt   | nobody else reads it                           |
   | muted, and up to which byte  | both        | the main loop writes it with interrupts off    |
   | bytes to send, their count   | main loop   | one word, written after the bytes              |
   | count of bytes sent          | interrupt   | one word                                       |

   The counts run freely modulo 2^32.  No record is read through a pointer to anything wider than a
   byte: a frame begins anywhere, and a Cortex-M0 faults on a word that is not aligned. */

#ifndef PORT_LINE_H
#define PORT_LINE_H

#include <stddef.h>
#include <stdint.h>

/* --- For the interrupts ------------------------------------------------------------------------ */

/* A byte arrived; its closing delimiter switches the output off if it ends MUTE (HG-6.6/1). */
void line_received(uint8_t byte, uint32_t ticks);
int line_next_byte(uint8_t *byte); /* the next byte to send; 0: there is none */

/* --- For the main loop ------------------------------------------------------------------------- */

/* The bytes up to the next delimiter, or as many as there are; `*t_us` is when the last arrived. */
size_t line_take(const uint8_t **data, int64_t *t_us);
void line_taken(size_t length); /* the board has seen them: a MUTE among them too */
int line_is_muted(void);        /* 1: a MUTE arrived that the board has not seen yet */
size_t line_until_unmuted(void); /* bytes to take up to the end of the last of them; 0: there is none */
int line_has_received(void);
size_t line_send(const uint8_t *data, size_t length); /* how many bytes found room */
int line_has_room(void);                              /* for a byte to send */
size_t line_waiting(void);                            /* bytes that were not sent yet */

#endif
