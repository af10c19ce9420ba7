"""The latched drive against the sent one, with the name of the fault if they differ."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Final

from haptogram_protocol import messages as m

from ..client import latching
from ..client.board_client import BoardClient
from ..outcome import check, check_equal, fail, unimplemented

_SHOWN: Final = 4  # transducers named in a message


@dataclass(frozen=True, slots=True)
class JudgeWitness:
    """The best source that shows the latched drive: read-back, else a trace.

    Attributes
    ----------
    board : BoardClient
        Board that is asked.
    mode : TraceMode or None
        Mode of the trace; None: the read-back is the source.
    """

    board: BoardClient
    mode: m.TraceMode | None

    @classmethod
    def of(cls, board: BoardClient) -> JudgeWitness:
        """Return the best source of *board*; UNIMPLEMENTED if there is none."""
        if board.has(m.Feature.READ_LATCHED):
            return cls(board, None)
        if not board.has(m.Feature.CONFIG):
            unimplemented("the board shows no drive: neither READ_LATCHED nor a trace")
        return cls(board, latching.ask_for_board_latches(board))

    def expect(self, registers: bytes, amplitudes: bytes | None = None, *, since: int = 0) -> None:
        """FAILED unless the last latch put this drive into the registers."""
        amplitudes = bytes([latching.FULL]) * len(registers) if amplitudes is None else amplitudes
        if self.mode is None:
            expect_witnessed_drive(
                self.board, latching.read_back(self.board), registers, amplitudes
            )
            return
        seen = latching.latches_received_from_board(self.board, since, self.mode)
        check(bool(seen), "no latch is traced")
        due = zlib.crc32(registers + amplitudes)
        check(
            seen[-1].crc == due,
            f"the trace has CRC-32 {seen[-1].crc:#010x} of the drive, due is {due:#010x}",
        )


def expect_witnessed_drive(
    board: BoardClient, shown: latching.ClientDrive, registers: bytes, amplitudes: bytes
) -> None:
    """FAILED, with the name of the fault, unless *shown* is the drive that was sent."""
    if (shown.phases, shown.amplitudes) == (registers, amplitudes):
        return
    wrong = [
        f"{number}: {found} instead of {due}"
        for number, (found, due) in enumerate(
            zip(
                zip(shown.phases, shown.amplitudes, strict=True),
                zip(registers, amplitudes, strict=True),
                strict=False,
            )
        )
        if found != due
    ]
    named = ", ".join(_named_drive_faults(board, shown, registers, amplitudes))
    fail(
        f"{named or 'another drive'}: {len(wrong)} transducers differ "
        f"((phase, amplitude) of {'; '.join(wrong[:_SHOWN])})"
    )


def judge_nothing_read_back(board: BoardClient, kind: m.DriveKind, text: str) -> None:
    """FAILED unless codes, key and time of the whole and of its last transducer are 0."""
    for first in (0, board.identity.transducers - 1):
        reply = latching.read_drive(board, kind, first)
        name = f"{text}: READ_DRIVE({kind.name}) from {first}"
        due = bytes(2 * (board.identity.transducers - first))
        check_equal(reply.data, due, f"{name}, of which all codes are to be 0")
        found = reply.key, reply.t_latch_us
        check_equal(found, (m.LatchKey(0, 0, 0), 0), f"{name} shows key and time {found}")


def _named_drive_faults(
    board: BoardClient, shown: latching.ClientDrive, registers: bytes, amplitudes: bytes
) -> tuple[str, ...]:
    """Return the names of faults that make the drive *shown* of the one due; () if there are none.

    The drive due has the phase codes *registers* and the amplitude codes *amplitudes*.
    """
    # Imported here: only a wrong drive pays for the acoustics.
    import numpy as np

    from haptogram.acoustics import Drive
    from haptogram.verification import name_drive_faults

    from .array_model import judged_drive_of_registers, judged_model_of_board

    latched = Drive(
        np.frombuffer(shown.phases, np.uint8), np.frombuffer(shown.amplitudes, np.uint8)
    )
    model = judged_model_of_board(board)
    return name_drive_faults(model, judged_drive_of_registers(registers, amplitudes), latched)
