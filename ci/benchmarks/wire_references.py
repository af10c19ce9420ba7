"""The wire as anyone would write it first: one byte at a time."""

import zlib

CRC_BYTES = 4


class BytewiseDecoder:
    """COBS and CRC-32 by a state machine, as it stands in many a firmware."""

    def __init__(self):
        self.start()

    def start(self):
        self.body, self.left, self.zero_due, self.broken = bytearray(), 0, False, False

    def feed(self, chunk):
        """Return the bodies of the frames that end in *chunk*."""
        bodies = []
        for byte in chunk:
            if byte == 0:
                if self.body and self.left == 0 and not self.broken and self.right():
                    bodies.append(bytes(self.body[:-CRC_BYTES]))
                self.start()
            elif self.left == 0:
                if self.zero_due:
                    self.body.append(0)
                self.left, self.zero_due = byte - 1, byte != 0xFF
            else:
                self.body.append(byte)
                self.left -= 1
        return bodies

    def right(self):
        crc = int.from_bytes(self.body[-CRC_BYTES:], "little")
        return zlib.crc32(self.body[:-CRC_BYTES]) == crc
