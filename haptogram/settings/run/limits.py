"""Seed of a run, and the limit of its verdict."""

from __future__ import annotations

from dataclasses import dataclass

from ..option import Settings, option


@dataclass(frozen=True, kw_only=True)
class LimitConfig(Settings):
    """Seed of the run, and the limit of its verdict."""

    min_verified: float | None = option(
        None,
        unit="SHARE",
        high=1.0,
        help="share of frames that must be verified",
        absent="1 in virtual time, else 0.9",
    )
    seed: int = option(
        0, unit="N", low=0, high=2**32 - 1, help="seed of everything random, faults among it"
    )
