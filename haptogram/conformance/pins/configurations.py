"""The configuration of the board at each moment, as its replies tell it."""

from __future__ import annotations

import bisect
import zlib
from dataclasses import dataclass

from haptogram_protocol.messages import (
    Config,
    ConfigReply,
    HelloReply,
    MessageType,
    SetConfigReply,
    UploadCommitReply,
)

from .dialogue import PinDialogue


@dataclass(frozen=True, slots=True)
class _Known:
    since: float
    config: Config | None
    is_plain: bool


class ConfigurationsByPins:
    """Configurations in force, from one reply of the board to the next request that changes them.

    Parameters
    ----------
    dialogue : PinDialogue
        The capture.
    """

    def __init__(self, dialogue: PinDialogue) -> None:
        count = next((reply.transducers for _, reply in dialogue.said(HelloReply)), 0)
        changes = MessageType.SET_CONFIG, MessageType.UPLOAD_COMMIT
        read = {(f.header.session, f.header.seq) for f in dialogue.to_board}
        found = [_Known(moment, None, False) for moment in dialogue.resets]
        found += [
            _Known(frame.arrival, None, False)
            for frame in dialogue.to_board
            if frame.header.type in changes
        ]
        for frame in dialogue.to_host:
            message, asked = frame.message, (frame.header.session, frame.header.seq)
            if isinstance(message, UploadCommitReply) and asked not in read:
                found.append(_Known(frame.begin, None, False))  # the analyser read it wrongly
            if isinstance(message, ConfigReply | SetConfigReply):
                crc = zlib.crc32(message.config.pack() + bytes(count))
                found.append(_Known(frame.begin, message.config, crc == message.config_crc))
        self._known = sorted(found, key=lambda one: one.since)

    def at(self, t: float) -> Config | None:
        """Return the configuration at a period of the capture; None: it is not known."""
        known = self._last(t)
        return None if known is None else known.config

    def is_plain(self, t: float) -> bool:
        """Return True if no phase correction is in force."""
        known = self._last(t)
        return known is not None and known.is_plain

    def _last(self, t: float) -> _Known | None:
        place = bisect.bisect_right(self._known, t, key=lambda one: one.since) - 1
        return self._known[place] if place >= 0 else None
