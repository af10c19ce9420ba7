"""The presets as text for a terminal: each with its published figures next to ours."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from haptogram.published import Preset

from .formats.console import console_paragraph, console_table


def presets_text(compared: Iterable[tuple[Preset, list[dict[str, Any]]]]) -> str:
    """Return each preset with its sources, and its published figures next to ours.

    Parameters
    ----------
    compared : iterable of (Preset, list of dict)
        Presets, each with the result of
        :func:`~haptogram.published.catalogue.compare_preset`.
    """
    return "\n\n".join("\n".join(_presets_text_section(*item)) for item in compared) + "\n"


def _presets_text_section(preset: Preset, rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield lines on one array: its source, and published beside computed figures (*rows*)."""
    yield from console_paragraph(f"{preset.name}: {preset.title}")
    yield from console_paragraph(f"source: {preset.source}", indent=2)
    yield from console_paragraph(f"geometry: {preset.array_source}", indent=2)
    place = ", ".join(f"{value * 1e3:g}" for value in preset.focus_m)
    yield f"  typical focus: ({place}) mm"
    head, *lines = console_table(
        ("", "published", "ours"),
        [
            (row["quantity"], row["published"], f"{row['ours']:.4g} {row['unit']}".rstrip())
            for row in rows
        ],
        indent=4,
    )
    yield head
    for line, row in zip(lines, rows, strict=True):
        yield line
        yield from console_paragraph(
            "; ".join(filter(None, (row["source"], row["remark"]))), indent=8
        )
