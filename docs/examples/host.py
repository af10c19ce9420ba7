"""A host in 40 lines, from nothing but SPEC.md: a focus 150 mm above a board of 16 x 16."""

import math
import random
import struct
import sys
import time
import zlib

import serial

HELLO, ARM, MUTE, PHASES, IMMEDIATE = 0x40, 0x41, 0x42, 0x01, 0x10


def frame(kind, seq, payload=b"", session=0, flags=0):
    body = struct.pack("<BBHIH", kind, flags, seq & 0xFFFF, 0, session) + payload
    body += struct.pack("<I", zlib.crc32(body))
    stuffed = b""
    for run in body.split(b"\0"):  # COBS: a code byte says how far the next zero is
        while len(run) >= 254:
            stuffed, run = stuffed + b"\xff" + run[:254], run[254:]
        stuffed += bytes([len(run) + 1]) + run
    return b"\0" + stuffed + b"\0"


def wait_for(port, kind):
    while received := port.read_until(b"\0"):
        if len(received) > 2 and received[1] == kind:  # the type is never zero: it stands as it is
            return  # events come unasked, and a first half frame may be left from another host
    sys.exit(f"no answer of type {kind:#x}")


port = serial.serial_for_url(sys.argv[1], baudrate=3_000_000, timeout=2)
session = random.randint(1, 0xFFFF)
port.write(frame(HELLO, 0, struct.pack("<BBHI", 2, 0, session, 0)))
wait_for(port, 0x80)
port.write(frame(ARM, 1, session=session))
wait_for(port, 0x81)
places = [((ix - 7.5) * 10.0, (iy - 7.5) * 10.0) for ix in range(16) for iy in range(16)]
codes = bytes(round(-256 * math.hypot(x, y, 150.0) / 8.60) % 256 for x, y in places)
for seq in range(100):  # a code delays its element; the first seq of a session is 0xFFF0
    port.write(frame(PHASES, 0xFFF0 + seq, codes, session, IMMEDIATE))
    time.sleep(0.005)
port.write(frame(MUTE, 2, session=session))
wait_for(port, 0x82)
sys.stdout.write("100 frames sent, the board is muted\n")
