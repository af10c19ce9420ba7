"""``haptogram capture``: phases, duties and latches in a capture of drive pins."""

from __future__ import annotations

import argparse
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from haptogram.machine.files import write_json_file
from haptogram.settings.parser import Parser, add_file_option, add_flag

from ..shell.exit_status import INCONCLUSIVE, USAGE
from ..shell.output_files import CommandOutputs

if TYPE_CHECKING:
    from collections.abc import Iterator


def set_up_capture(parser: Parser) -> None:
    """Add the options of the command."""
    parser.set_defaults(run=run_capture)
    add_file_option(parser, "file", help="the capture")
    add_file_option(parser, "--map", required=True, help="TOML of its channels")
    add_file_option(parser, "--json", help="write every drive as JSON")
    add_flag(parser, "--quiet", help="no tables, only the summary and the findings")


def run_capture(arguments: argparse.Namespace) -> int:
    """Measure the capture, print it, and return the exit status."""
    from haptogram.evidence.captures import findings as told
    from haptogram.evidence.captures.channel_map import ChannelMap
    from haptogram.evidence.captures.files import read_capture
    from haptogram.evidence.captures.pin_record import pin_record_of_capture
    from haptogram.verification.pins.held.drives import held_pin_drives

    outputs = CommandOutputs(arguments, "json")
    mapped = ChannelMap.from_file(Path(arguments.map))
    capture = read_capture(Path(arguments.file))
    found = held_pin_drives(pin_record_of_capture(capture, mapped))
    wrong = told.findings_of_capture(found)
    document = told.capture_document(found, wrong)
    lines = told.summary_of_capture(found, capture)
    if not arguments.quiet:
        lines += [*_capture_elements_rows(document), *_capture_latches_rows(document)]
    lines += [f"note: {note}" for note in document["notes"]]
    lines += [f"wrong: {text}" for text in wrong] or ["nothing wrong was found"]
    print("\n".join(lines), file=outputs.text)
    if not outputs.write_files(json=lambda path: write_json_file(path, document)):
        return USAGE
    if wrong:
        return 1
    return INCONCLUSIVE if document["cut"] else 0


def _capture_elements_rows(document: dict[str, Any]) -> Iterator[str]:
    """Yield a heading and a line for each captured element: edges, duty, period and jitter.

    There are dashes for an element without pulses.
    """
    titles = f"{'channel':<12}{'element':>8}{'edges':>10}{'duty':>18}"
    yield f"{titles}{'period µs':>12}{'jitter ns':>11}"
    for row in document["elements"]:
        head = f"{row['channel']:<12}{row['element']:>8}{row['edges']:>10}"
        duties = [duty for duty in row["duty"] if duty]
        periods_us, jitters_ns = (
            [value for value in row[name] if value is not None]
            for name in ("period_us", "jitter_ns")
        )
        if not duties or not periods_us:
            yield f"{head}{'-':>18}{'-':>12}{'-':>11}"
            continue
        duty = f"{min(duties):.3f} to {max(duties):.3f}"
        yield f"{head}{duty:>18}{fmean(periods_us):>12.4f}{max(jitters_ns):>z11.1f}"


def _capture_latches_rows(document: dict[str, Any]) -> Iterator[str]:
    """Yield a heading and a line for each latch: time, channels, and in how many µs they change."""
    yield f"{'latch':<7}{'at ms':>12}{'channels':>10}{'within µs':>11}"
    period_us = 1e6 / document["carrier_hz"]
    for number, latch in enumerate(document["latches"]):
        torn = "  torn" if latch["torn"] else ""
        silent = "  silent from here" if latch["silent"] else ""
        yield (
            f"{number:<7}{latch['t_us'] / 1e3:>12.4f}{latch['channels']:>10}"
            f"{latch['skew_us'] + period_us:>11.1f}{torn}{silent}"
        )
