"""The configuration of the board at each moment, as its replies tell it."""

from __future__ import annotations

import bisect
import zlib
from collections.abc import Sequence
from typing import TypeVar

from haptogram_protocol import messages as m

from .dialogue import PinDialogue
from .reported_drives import DrivesOfPinDialogue

_T = TypeVar("_T")


class ConfigurationsByPins:
    """Configurations in force, from one reply of the board to the next request that changes them.

    Parameters
    ----------
    dialogue : PinDialogue
        The capture.
    asked : DrivesOfPinDialogue
        The uploads in it.
    """

    def __init__(self, dialogue: PinDialogue, asked: DrivesOfPinDialogue) -> None:
        taken = [one for one in asked.uploads if one.begin.kind is m.UploadKind.CORRECTION]
        known = [bytes(asked.count), *(one.data for one in taken if one.data is not None)]
        read = {(f.header.session, f.header.seq) for f in dialogue.to_board}
        configs: list[tuple[float, m.Config | None]] = [(t, None) for t in dialogue.resets]
        corrections: list[tuple[float, bytes | None]] = [(t, None) for t in dialogue.resets]
        for frame in dialogue.to_board:
            if frame.header.type == m.MessageType.SET_CONFIG:
                configs.append((frame.arrival, None))
            elif isinstance(frame.message, m.UploadCommit) and frame.message.target == 0:
                corrections.append((frame.arrival, None))
        corrections += [(one.since, one.data) for one in taken]
        for frame in dialogue.to_host:
            message, request = frame.message, (frame.header.session, frame.header.seq)
            if isinstance(message, m.UploadCommitReply) and request not in read:
                corrections.append((frame.begin, None))  # the analyser read it wrongly
            if isinstance(message, m.ConfigReply | m.SetConfigReply):
                packed = message.config.pack()
                fitting = (c for c in known if zlib.crc32(packed + c) == message.config_crc)
                configs.append((frame.begin, message.config))
                corrections.append((frame.begin, next(fitting, None)))
        self._configs = sorted(configs, key=_begin_of_configuration)
        self._corrections = sorted(corrections, key=_begin_of_configuration)

    def at(self, t: float) -> m.Config | None:
        """Return the configuration at a period of the capture; None: it is not known."""
        return _last_configuration(self._configs, t)

    def of_ramp(self, end: float, per_ms: float) -> tuple[m.Config, float] | None:
        """Return configuration and beginning of the ramp that ends at a period (HG-6.11/6).

        A configuration that was set during the ramp has no part in it. None: it is not known, or
        two configurations fit.
        """
        found: list[tuple[m.Config, float]] = []
        until = end
        for since, config in reversed(self._configs):
            if since >= end:
                continue
            if config is None:
                until = since
                continue
            begin = end - config.ramp_ms * per_ms
            if since <= begin < until or (not config.ramp_ms and until == end):
                found.append((config, begin))
            until = since
        return found[0] if len(found) == 1 else None

    def set_between(self, begin: float, end: float) -> list[tuple[float, float, int | None]]:
        """Return the requests, replies and ceilings of what was set between two periods, in order.

        It is in force from its reply on, and may be from its request on. None: it is not known,
        and the reply is at the end.
        """
        found: list[tuple[float, float, int | None]] = []
        asked: float | None = None
        for t, config in self._configs:
            if config is None:
                asked = t if asked is None else asked
            elif asked is not None:
                if asked < end and t > begin:
                    found.append((asked, t, config.amplitude_ceiling))
                asked = None
        if asked is not None and asked < end:
            found.append((asked, end, None))
        return found

    def correction(self, t: float) -> bytes | None:
        """Return the phase correction at a period of the capture; None: it is not known."""
        return _last_configuration(self._corrections, t)


def _begin_of_configuration(item: tuple[float, object]) -> float:
    """Return the time of a (time, configuration) pair, the key to search by."""
    return item[0]


def _last_configuration(known: Sequence[tuple[float, _T | None]], t: float) -> _T | None:
    """Return the configuration in force at *t*; None if there is none yet, or it is unknown.

    *known*: (time, configuration), sorted. Times are carrier periods of the capture.
    """
    place = bisect.bisect_right(known, t, key=_begin_of_configuration) - 1
    return known[place][1] if place >= 0 else None
