"""The same wire with the bytes of the host and a display, for `haptogram verify`."""

import dataclasses

from haptogram_protocol.dialects.codec import Display, OneWayHostEnd
from our_board import EMULATION as BOARD
from our_board import Show


class HostEnd(OneWayHostEnd):
    def send(self, message):
        return b"\x55" + message.codes + bytes([sum(message.codes) & 0xFF])


class Phases(Display):
    def frame(self, codes):
        return [Show(bytes(16 if code is None else code for code in codes))]

    def read(self, operations):
        shown = operations[-1].codes if operations else b""
        return [None if code == 16 else code for code in shown] or None


WIRE = dataclasses.replace(BOARD.dialect, host=HostEnd, display=lambda boards: Phases(16, 16))
EMULATION = dataclasses.replace(BOARD, dialect=WIRE)
