"""The wire as anyone would write it first: one byte at a time."""

import zlib

CRC_BYTES = 4
SHORTEST = 14  # header and CRC


class BytewiseDecoder:
    """COBS and CRC-32 by a state machine, as it stands in many a firmware."""

    def __init__(self):
        self.start()

    def start(self):
        self.received, self.left, self.zero_due, self.body = 0, 0, False, bytearray()

    def feed(self, chunk):
        """Return a body, or the name of its damage, for every frame that ends in *chunk*."""
        found = []
        for byte in chunk:
            if byte == 0:
                if self.received:
                    found.append(self.outcome())
                self.start()
                continue
            self.received += 1
            if self.left == 0:
                if self.zero_due:
                    self.body.append(0)
                self.left, self.zero_due = byte - 1, byte != 0xFF
            else:
                self.body.append(byte)
                self.left -= 1
        return found

    def outcome(self):
        if self.left:
            return "cobs"
        if len(self.body) < SHORTEST:
            return "short"
        body, crc = bytes(self.body[:-CRC_BYTES]), self.body[-CRC_BYTES:]
        return body if zlib.crc32(body) == int.from_bytes(crc, "little") else "crc"
