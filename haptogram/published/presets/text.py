"""The presets as text for a terminal, at most 100 columns wide."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from typing import Any, Final

from haptogram.published.presets.figures import Preset

_WIDTH: Final = 98


def render(compared: Iterable[tuple[Preset, list[dict[str, Any]]]]) -> str:
    """Return what each preset is, and its published figures next to ours.

    Parameters
    ----------
    compared : iterable of (Preset, list of dict)
        Presets with what :func:`~haptogram.published.presets.compare` says of them.
    """
    return "\n\n".join("\n".join(_section(*item)) for item in compared) + "\n"


def _section(preset: Preset, rows: list[dict[str, Any]]) -> Iterator[str]:
    yield from _wrapped(f"{preset.name}: {preset.title}", "")
    yield from _wrapped(f"source: {preset.source}", "  ")
    yield from _wrapped(f"geometry: {preset.array_source}", "  ")
    place = ", ".join(f"{value * 1e3:g}" for value in preset.focus_m)
    yield f"  typical focus: ({place}) mm"
    yield f"    {'':<34} {'published':<32} ours"
    for row in rows:
        ours = f"{row['ours']:.4g} {row['unit']}"
        yield f"    {row['quantity']:<34} {row['published']:<32} {ours}".rstrip()
        yield from _wrapped("; ".join(filter(None, (row["source"], row["remark"]))), "        ")


def _wrapped(text: str, indent: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent=indent, subsequent_indent=indent + "  ")
