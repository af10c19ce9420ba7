"""Characters that a UART receives at another rate than its own.

A receiver finds the falling edge of the start bit, then looks at the line in the middle of each of
its own bits.  In a character of 10 bits the last look, at the stop bit, comes 9.5 bits after that
edge, so rates may differ by half a bit in 9.5, 5.3 %, before anything is damaged.  (Real receivers
give up a little sooner, as they sample sixteen times a bit and see the edge late: NXP states 4.5 %
in the reference manual of its KL27, Microchip 4.5 % for the AVR, "Error Tolerance".)
"""

from __future__ import annotations

from typing import Final

BITS_PER_BYTE: Final = 10  # start bit, 8 data bits, stop bit
FRAMING_ERROR: Final = 0  # what a raw terminal reads in place of such a character: termios(3)
_STOP_MIDDLE: Final = BITS_PER_BYTE - 0.5


def is_baud_understood(ratio: float) -> bool:
    """Return True if every character arrives whole; see :func:`sample_uart_characters`."""
    return abs(_STOP_MIDDLE * (ratio - 1)) < 0.5


def sample_uart_characters(data: bytes, ratio: float) -> tuple[bytes, int]:
    """Return the received characters of *data*, sent back to back on an idle line.

    Parameters
    ----------
    ratio : float
        Rate of the sender, divided by that of the receiver.

    Returns
    -------
    received : bytes
        Fewer than were sent, if a sender that is too fast hides edges; more, if in a character of
        one that is too slow an edge is left over; never none of some.  :data:`FRAMING_ERROR` stands
        where a stop bit was missing.
    errors : int
        How many stop bits were missing.
    """
    if is_baud_understood(ratio):
        return data, 0
    levels = _uart_line_levels(data)
    received, errors, at = bytearray(), 0, 1
    while (edge := levels.find(b"\x01\x00", at - 1)) >= 0:
        edge += 1  # the bit that is low
        looks = [levels[min(int(edge + (k + 0.5) * ratio), len(levels) - 1)] for k in range(10)]
        at = int(edge + _STOP_MIDDLE * ratio) + 1
        if looks[0]:  # a glitch, no start bit
            at = edge + 1
            continue
        errors += not looks[9]
        value = sum(bit << k for k, bit in enumerate(looks[1:9]))
        received.append(value if looks[9] else FRAMING_ERROR)
    return bytes(received), errors


def _uart_line_levels(data: bytes) -> bytes:
    """Return the line, a level of 0 or 1 for each bit of the sender, idle before and after."""
    levels = bytearray(b"\x01")
    for byte in data:
        levels += bytes((0, *(byte >> k & 1 for k in range(8)), 1))
    return bytes(levels + b"\x01" * BITS_PER_BYTE)
