"""The same bytes to the emulation of a board and to its simulated firmware, compared at the pins.

Streams are made of whole, short and overlong frames, commands and random bytes.  The drives are
compared after each piece, up to one phase that all channels share.  Hypothesis shrinks the
first difference to the shortest stream.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Sequence

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from haptogram.acoustics.arrays import ComplexArray
from haptogram.errors import HaptogramError
from haptogram.evidence.dialects.latches import pulse_observation_of
from haptogram.settings.board import BoardConfig
from haptogram.settings.board_url import PortConfig
from haptogram_protocol.dialects.codec import Dialect
from sim_device.dialects.table import emulation_of, read_emulation_options
from sim_device.protocol_haptogram import open_virtual_port

REST_NS = 500_000  # behind a piece, until the pins are compared
STEP = 0.5  # share of a step of the phase that the pins may differ by
MOST_PIECES, MOST_BYTES = 6, 40


class Differential:
    """One board twice: emulated, and simulated."""

    def __init__(self, config: BoardConfig, simulator: str) -> None:
        self.boards = [
            config,
            BoardConfig.of(**{**config.non_default(), "simulator": simulator}),
        ]
        emulation = emulation_of(str(config.dialect))
        self.dialect = emulation.dialect
        self.count = emulation.boards(read_emulation_options(emulation, config.dialect_option))
        self.streams = self.bytes = 0

    def check(self, pieces: Sequence[bytes]) -> None:
        """Raise an AssertionError that names the first piece behind which the pins differ."""
        emulated, simulated = (self.drives(board, pieces) for board in self.boards)
        self.streams, self.bytes = self.streams + 1, self.bytes + sum(map(len, pieces))
        for place, (ours, theirs) in enumerate(zip(emulated, simulated, strict=True)):
            shared = np.exp(1j * np.angle(np.vdot(ours, theirs)))
            error = np.abs(theirs - ours * shared)
            wrong = np.flatnonzero(error > STEP * 2.0 * np.pi / self.dialect.steps)
            if wrong.size:
                channel = int(wrong[0])
                raise AssertionError(
                    f"{wrong.size} of {len(ours)} channels differ; channel {channel}: emulated "
                    f"{shown_drive(ours[channel] * shared)}, simulated "
                    f"{shown_drive(theirs[channel])}; behind: {shown_bytes(pieces[:place])}"
                )

    def drives(self, board: BoardConfig, pieces: Sequence[bytes]) -> list[ComplexArray]:
        """Return the drive at power-up, and behind each piece."""
        port = open_virtual_port(PortConfig(board=board, clock="virtual", reconstruct=False))
        seen = []
        try:
            for piece in (b"", *pieces):
                port.write(piece)
                port.flush()
                port.wait_until_ns(port.now_ns() + REST_NS)
                port.read(port.in_waiting)
                latch = [record for record in port.records if record["kind"] == "pulses"][-1]
                seen.append(pulse_observation_of(latch, port.records[0]["channels"]).weights)
        finally:
            port.close()
        return seen


def shown_bytes(pieces: Sequence[bytes]) -> str:
    """Return bytes in hex, those that repeat once."""
    runs = [(value, len(list(run))) for value, run in itertools.groupby(b"".join(pieces))]
    return " ".join(f"{v:02x}" + (f"({n} times)" if n > 1 else "") for v, n in runs) or "nothing"


def shown_drive(weight: complex) -> str:
    """Return the amplitude and the phase of a channel."""
    degrees = np.rad2deg(np.angle(weight)) % 360.0
    return "off" if abs(weight) < 0.01 else f"{abs(weight):.2f} at {degrees:.0f} degrees"


def frame_bytes(dialect: Dialect, count: int, codes: Sequence[int | None]) -> bytes:
    """Return a whole frame for all boards."""
    display = dialect.display(count)  # type: ignore[misc]  checked by the caller
    host = dialect.host(**display.options)
    return b"".join(host.send(operation) for operation in display.frame(codes))


def pieces_of(dialect: Dialect, count: int) -> st.SearchStrategy[list[bytes]]:
    """Return streams: frames, some cut short or too long, and hostile bytes."""
    channels = dialect.channels * count
    code = st.one_of(st.none(), st.integers(0, dialect.steps - 1))
    few = st.lists(code, min_size=1, max_size=32)
    codes = few.map(lambda some: (some * channels)[:channels])  # few choices shrink soon
    frames = codes.map(lambda some: frame_bytes(dialect, count, some))
    short = st.tuples(frames, st.integers(1, dialect.frame_bytes(count) - 1)).map(
        lambda cut: cut[0][: -cut[1]]
    )
    hostile = st.binary(max_size=MOST_BYTES)
    long = st.tuples(frames, hostile).map(lambda both: both[0][:-1] + both[1] + both[0][-1:])
    return st.lists(st.one_of(frames, short, long, hostile), min_size=1, max_size=MOST_PIECES)


def main(words: Sequence[str] | None = None) -> int:
    """Run the examples; return 1 if the pins differ."""
    parser = argparse.ArgumentParser(prog="ci/differential", description=__doc__)
    parser.add_argument("--dialect", required=True, metavar="NAME")
    parser.add_argument("--dialect-option", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--simulator", required=True, metavar="COMMAND")
    parser.add_argument("--array", help="of a board with fewer pins than the dialect")
    parser.add_argument("--examples", type=int, default=60, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    given_words = parser.parse_args(words)
    try:
        array = {} if given_words.array is None else {"array": given_words.array}
        options = {"dialect": given_words.dialect, "dialect_option": given_words.dialect_option}
        board = BoardConfig.of(**options, **array)
        compared = Differential(board, given_words.simulator)
        if compared.dialect.display is None:
            parser.error(f"nobody drives boards of the dialect {given_words.dialect} here")

        @seed(given_words.seed)
        @settings(
            max_examples=given_words.examples,
            database=None,
            deadline=None,
            phases=(Phase.generate, Phase.shrink),
            suppress_health_check=list(HealthCheck),
            report_multiple_bugs=False,
        )
        @given(pieces_of(compared.dialect, compared.count))
        def agree(pieces: list[bytes]) -> None:
            compared.check(pieces)

        agree()
    except AssertionError as error:
        return ended(1, f"DIFFERENT: {error}")
    except HaptogramError as error:
        return ended(2, str(error))
    return ended(0, f"{compared.streams} streams, {compared.bytes} bytes: the pins agree")


def ended(status: int, text: str) -> int:
    """Write the result, and return *status*."""
    (sys.stderr if status > 1 else sys.stdout).write(f"ci/differential: {text}\n")
    return status


if __name__ == "__main__":
    sys.exit(main())
