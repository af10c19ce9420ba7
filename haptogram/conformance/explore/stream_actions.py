"""Stream frames of a random host, in time and late, in order and not, of every format."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Final

from haptogram_protocol.messages import (
    Drives,
    Feature,
    Flag,
    FocalPoint,
    HelloReply,
    Message,
    PhaseFormat,
    Phases,
    Points,
    build_body,
    pack_phases,
)

from .actions import SLOT_US, DialogueHost

#: What an action is made of: its name, its text and the body.
MadeAction = tuple[str, str, Callable[[DialogueHost], bytes]]

UNKNOWN_FLAGS: Final = (0x20, 0x40, 0x80)


class RandomStream:
    """Makes stream frames.

    Parameters
    ----------
    identity : HelloReply
        The board, with its capabilities and limits.
    source : random.Random
        Chance.
    """

    def __init__(self, identity: HelloReply, source: random.Random) -> None:
        self._identity = identity
        self._random = source
        self._can = Feature(identity.features & sum(Feature))

    def frame(self, slot: int) -> MadeAction:
        """Return a frame sent in *slot*."""
        pick = self._random.choice
        message = self._drive()
        # In slots from now on; -1, -3: 10 ms and 60 ms late; the horizon: far beyond it.
        ahead = pick((None, None, 0.5, 0.5, 1.5, 1.5, 2.5, 3.5, 6.5, "late", "too late", "far"))
        step = self._random.choices((0, 1, -1, 300), (14, 1, 2, 0.3))[0]
        flags = pick([0] * 14 + list(UNKNOWN_FLAGS))
        wrong = pick([0] * 14 + [0x0101])
        apart_us = pick((0, 0, 25, 1000, 3000))
        cut = pick([0] * 18 + [1])

        def body(host: DialogueHost) -> bytes:
            host.stream_next += max(0, step)
            seq = host.stream_next + min(0, step)
            host.stream_next += step >= 0
            offsets = {"late": -10_000, "too late": -60_000}
            far_us = 2 * host.identity.max_horizon_us
            us = far_us if ahead == "far" else offsets.get(str(ahead), 0)
            if isinstance(ahead, float):
                us = round(ahead * SLOT_US) + apart_us
            time_us = host.start_us + slot * SLOT_US + us
            whole = build_body(
                message,
                flags=flags | (Flag.IMMEDIATE if ahead is None else 0),
                seq=seq & 0xFFFF,
                time_us=time_us & 0xFFFFFFFF,
                session=host.session ^ wrong,
            )
            return whole[: len(whole) - cut]

        when = "at once" if ahead is None else f"for {ahead} slots ahead"
        name = message.TYPE.name
        return (
            f"{name} {when.rsplit(' slots')[0]}",
            f"{name} {when}, step {step}, flags {flags:#x}, session ^ {wrong}",
            body,
        )

    def _drive(self) -> Message:
        count, pick = self._identity.transducers, self._random.choice
        kinds: list[Callable[[], Message]] = []
        for bits, bit in ((8, 1), (6, 2), (5, 4)):
            if self._identity.phase_formats & bit:
                kinds.append(lambda bits=bits: self._phases(bits))  # type: ignore[misc]
        if self._can & Feature.AMPLITUDE:
            codes = self._random.randbytes(2 * count)
            kinds.append(lambda: Drives(PhaseFormat.BITS_8, 0, codes))
        if self._can & Feature.POINTS:
            kinds.append(lambda: Points((self._point(),)))
        return pick(kinds)()

    def _phases(self, bits: int) -> Message:
        count = self._identity.transducers
        codes = bytes(self._random.randrange(1 << bits) for _ in range(count))
        return Phases(PhaseFormat(bits), 0, pack_phases(codes, PhaseFormat(bits)))

    def _point(self) -> FocalPoint:
        across = self._random.randrange
        level = across(30_000, 65_536)
        x_um, y_um = across(-40_000, 40_000), across(-40_000, 40_000)
        return FocalPoint(x_um, y_um, across(80_000, 200_000), level, across(65_536))
