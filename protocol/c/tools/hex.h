/* Bytes as text, for the tools. */

#ifndef HEX_H
#define HEX_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

static int hex_digit(char c)
{
    const char *digits = "0123456789abcdef";
    const char *found = c == '\0' ? NULL : strchr(digits, c);

    return found == NULL ? -1 : (int)(found - digits);
}

/* Read pairs of digits up to the first other character; return the number of bytes. */
static size_t hex_read(uint8_t *to, size_t capacity, const char *from)
{
    size_t length = 0;

    while (length < capacity && hex_digit(from[0]) >= 0 && hex_digit(from[1]) >= 0) {
        to[length++] = (uint8_t)(hex_digit(from[0]) << 4 | hex_digit(from[1]));
        from += 2;
    }
    return length;
}

static void hex_print(const uint8_t *data, size_t length)
{
    size_t i;

    for (i = 0; i < length; i++)
        printf("%02x", data[i]);
    if (length == 0)
        printf("-");
}

#endif
