"""A driver of another repository: nothing of this project, its own bytes (SPEC.md chapters 2 to 6).

The tests copy this file into a folder of its own.
"""

import math
import struct
import zlib

import serial

PITCH_M, SIDE = 0.01, 8
WAVELENGTH_M = 343.987 / 40_000


def stuffed(data):
    """Return the COBS of *data*."""
    out, block = bytearray(), bytearray()
    for byte in data:
        if byte:
            block.append(byte)
        if not byte or len(block) == 254:
            out += bytes([len(block) + 1]) + block
            block = bytearray()
    return bytes(out + bytes([len(block) + 1]) + block)


def codes(x, y, z):
    """Return the 8-bit phase codes of a focus, in metres: element n = ix * SIDE + iy."""
    middle = (SIDE - 1) / 2
    found = []
    for ix in range(SIDE):
        for iy in range(SIDE):
            away = math.dist((x, y, z), ((ix - middle) * PITCH_M, (iy - middle) * PITCH_M, 0))
            found.append(round(-away / WAVELENGTH_M * 256) % 256)
    return bytes(found)


class OwnDriver:
    """Arms, shows focus after focus as soon as it is complete, mutes."""

    def __init__(self, port, mirrored=False, skips=(), mutes=True):
        self.port = serial.serial_for_url(port, timeout=5)
        self.session, self.seq, self.index = 0x1234, 0, 0xFFF0
        self.mirrored, self.skips, self.mutes = mirrored, skips, mutes
        self.ask(0x40, struct.pack("<BBHI", 2, 0, self.session, 0), session=0)
        self.ask(0x41)

    def send(self, kind, seq, payload, flags=0, session=None):
        session = self.session if session is None else session
        body = struct.pack("<BBHIH", kind, flags, seq, 0, session) + payload
        self.port.write(b"\0" + stuffed(body + struct.pack("<I", zlib.crc32(body))) + b"\0")

    def ask(self, kind, payload=b"", session=None):
        self.send(kind, self.seq, payload, session=session)
        self.seq += 1
        while self.reply() != kind + 0x40:
            pass

    def reply(self):
        piece = b""
        while not piece:
            piece = self.port.read_until(b"\0")[:-1]
        return piece[1] if piece[0] > 1 else 0  # the type: behind the first code of COBS

    def show(self, foci):
        for number, (x, y, z) in enumerate(foci):
            if number not in self.skips:
                phases = codes(-x if self.mirrored else x, y, z)
                self.send(0x01, self.index & 0xFFFF, phases, flags=0x10)
                self.ask(0x44, struct.pack("<Q", number))  # the board has taken the frame
            self.index += 1

    def close(self):
        if self.mutes:
            self.ask(0x42)
        self.port.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
