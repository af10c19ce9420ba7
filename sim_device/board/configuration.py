"""Settings of the host, and their bounds.  SPEC.md HG-7.1."""

from __future__ import annotations

import zlib
from typing import Final

from haptogram_protocol.framing import CRC_BYTES
from haptogram_protocol.messages import Config, ErrorCode, Header, Status
from haptogram_protocol.rules import CONFIG_BOUNDS, TRACE_CAPABILITIES

from .refusal import RefusalError
from .settings import BoardSettings

_LEAST_STATUS_MS: Final = CONFIG_BOUNDS["status_period_ms"][0]
_STATUS_SHARE: Final = 10  # STATUS may take one part in so many of the line
_FRAMING_BYTES: Final = 3  # two delimiters and the code byte of COBS
_BITS_PER_BYTE: Final = 10  # start, 8 data, stop


def _least_status_period_ms(baud: int | None) -> int:
    """Return the shortest status period that leaves nine tenths of the line to others.

    *baud* None: the shortest that SPEC.md allows.
    """
    size = Header.LAYOUT.size + Status.LAYOUT.size + CRC_BYTES + _FRAMING_BYTES
    if baud is None:
        return _LEAST_STATUS_MS
    return max(_LEAST_STATUS_MS, -(-size * _BITS_PER_BYTE * _STATUS_SHARE * 1000 // baud))


def initial_board_config(settings: BoardSettings) -> Config:
    """Return the configuration after power-up: the defaults, as far as the line allows."""
    period_ms = max(Config().status_period_ms, _least_status_period_ms(settings.line.baud))
    return Config(
        sound_speed_mm_s=round(settings.model.medium.sound_speed_m_s * 1000),
        status_period_ms=min(period_ms, 0xFFFF),
    )


def check_board_config(config: Config, settings: BoardSettings) -> None:
    """Raise :class:`RefusalError` (BAD_VALUE with the field's offset) for a value out of bounds."""
    if int(TRACE_CAPABILITIES[config.trace_mode]) & ~int(settings.features):
        raise RefusalError(ErrorCode.BAD_VALUE, Config.WIRE["trace_mode"].offset)
    for name, (low, high) in CONFIG_BOUNDS.items():  # in the order of the fields
        value = getattr(config, name)
        if name == "status_period_ms":
            low = _least_status_period_ms(settings.line.baud) if value else 0
        if not low <= value <= high:
            raise RefusalError(ErrorCode.BAD_VALUE, Config.WIRE[name].offset)


def board_config_crc(config: Config, correction: bytes) -> int:
    """Return the CRC-32 that names a configuration and a phase correction."""
    return zlib.crc32(config.pack() + correction)
