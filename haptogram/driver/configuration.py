"""The configuration of a board, as its host knows it: read, changed, read again in doubt."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

from haptogram.driver.frames.frame import Frame
from haptogram.driver.line.link import Link
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_whole
from haptogram_protocol import LocalProtocolError, messages


class SessionConfiguration:
    """Reads and changes the configuration of one board.

    Parameters
    ----------
    link : Link
    identity : HelloReply
        Its features say whether the board can be configured.

    Attributes
    ----------
    known : Config
        The configuration that the board confirmed last.
    """

    def __init__(self, link: Link, identity: messages.HelloReply) -> None:
        self._link = link
        self._identity = identity
        self.known = self.read()

    def read(self) -> messages.Config:
        """Ask the board for its configuration and return it."""
        self.known = self._link.request(messages.GetConfig(), messages.ConfigReply).config
        self._in_doubt = False
        return self.known

    def confirmed(self) -> messages.Config:
        """Return the configuration; ask the board if the answer to a change was lost."""
        return self.read() if self._in_doubt else self.known

    def change(self, **changes: Any) -> messages.Config:
        """Change fields of :class:`~haptogram_protocol.messages.Config` and return the result.

        Raises
        ------
        ConfigurationError
            If there is no such field, or a value does not fit its field.
        DeviceError
            If the board refuses a value.
        """
        fields = {field.name for field in dataclasses.fields(messages.Config)}
        if unknown := sorted(set(changes) - fields):
            raise ConfigurationError(
                f"configuration has no {unknown[0]!r}; it has {', '.join(sorted(fields))}"
            )
        for name, value in changes.items():
            check_whole(name, value, 0, 2**32 - 1)
        wanted = messages.SetConfig(dataclasses.replace(self.confirmed(), **changes))
        self._in_doubt = True  # the board may apply the change, and its answer be lost
        try:
            self.known = self._link.request(wanted, messages.SetConfigReply).config
        except LocalProtocolError as error:
            self._in_doubt = False
            raise ConfigurationError(f"configuration {changes} does not fit: {error}") from error
        self._in_doubt = False
        return self.known

    def agree_on_sound_speed(self, frames: Iterable[Frame]) -> None:
        """Set the speed of sound for which *frames* of focal points were made.

        Raises
        ------
        ConfigurationError
            If the board assumes another speed of sound and has no configuration to change.
        """
        known = self.confirmed()
        speeds = (f.sound_speed_mm_s for f in frames if f.sound_speed_mm_s is not None)
        speed_mm_s = next(speeds, None)
        if speed_mm_s is None or speed_mm_s == known.sound_speed_mm_s:
            return
        if not self._identity.features & messages.Feature.CONFIG:
            raise ConfigurationError(
                f"the frames are for a speed of sound of {speed_mm_s / 1000:g} m/s; the board "
                f"assumes {known.sound_speed_mm_s / 1000:g} m/s and cannot be told"
            )
        self.change(sound_speed_mm_s=speed_mm_s)
