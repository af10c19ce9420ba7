"""``haptogram capture``: phases, duties and latches in a capture of drive pins."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Final

from haptogram.settings.parser import file_name_option

from ..shell.exit_status import INCONCLUSIVE, USAGE
from ..shell.output_files import CommandOutputs

if TYPE_CHECKING:
    from collections.abc import Iterator

    from haptogram.evidence.captures.measure import CaptureDrives, ElementDrives
    from haptogram.settings.parser import Parser

_EPILOG: Final = """\
examples:
  haptogram capture pins.sr --map map.toml
      what a logic analyser saw at the drive pins: a line for each channel and each latch
  haptogram capture pins.vcd --map map.toml --json - --quiet

The map is TOML: reference = "D0" names the channel that phases are relative to (a carrier clock, or
an element), latch = "D1" one that rises at each latch, [elements] the elements: D2 = 0.
docs/captures.md tells the rest.

exit status:
  0    nothing is wrong
  1    a dead, stuck or inverted pin, or a torn latch
  2    usage or environment error: also a capture without edges, or with too few samples a period
  3    nothing wrong was found, and the file was cut off
  130  interrupted (Ctrl-C, SIGTERM, SIGHUP)
"""


def set_up_capture(parser: Parser) -> None:
    """Describe the command and add its options."""
    parser.description = (
        "Measure the drive pins in a capture of a logic analyser (VCD, or .sr of sigrok and "
        "PulseView): phase, duty, period and jitter of each channel, and each latch."
    )
    parser.epilog = _EPILOG
    parser.set_defaults(run=run_capture)
    parser.add_argument("file", type=file_name_option, metavar="FILE", help="the capture")
    parser.add_argument(
        "--map", type=file_name_option, required=True, metavar="FILE", help="TOML of its channels"
    )
    parser.add_argument(
        "--json", type=file_name_option, metavar="FILE", help="write every drive as JSON"
    )
    parser.add_argument("--quiet", action="store_true", help="no table, findings only")


def run_capture(arguments: argparse.Namespace) -> int:
    """Measure the capture, print it, and return the exit status."""
    from haptogram.evidence.captures import findings as told
    from haptogram.evidence.captures.channel_map import ChannelMap
    from haptogram.evidence.captures.files import read_capture
    from haptogram.evidence.captures.measure import measure_capture
    from haptogram.machine.files import write_json_file

    outputs = CommandOutputs(arguments, "json")
    mapped = ChannelMap.from_file(Path(arguments.map))
    found = measure_capture(read_capture(Path(arguments.file)), mapped)
    wrong = told.findings_of_capture(found, active_low=mapped.settings.active_low)
    lines = told.summary_of_capture(found)
    if not arguments.quiet:
        lines += [*_capture_elements_rows(found), *_capture_latches_rows(found)]
    lines += [f"note: {note}" for note in told.notes_of_capture(found)]
    lines += [f"wrong: {text}" for text in wrong] or ["nothing wrong was found"]
    print("\n".join(lines), file=outputs.text)
    document = told.capture_document(found, wrong)
    if not outputs.write_files(json=lambda path: write_json_file(path, document)):
        return USAGE
    if wrong:
        return 1
    return INCONCLUSIVE if found.capture.cut else 0


def _capture_elements_rows(found: CaptureDrives) -> Iterator[str]:
    titles = f"{'channel':<12}{'element':>8}{'edges':>10}{'duty':>18}"
    yield f"{titles}{'period µs':>12}{'jitter ns':>11}"
    for row in found.elements:
        yield _capture_element_row(row)


def _capture_element_row(row: ElementDrives) -> str:
    import numpy as np

    head = f"{row.channel:<12}{row.element:>8}{row.edges:>10}"
    sounding = np.nan_to_num(row.duties) > 0
    if not sounding.any():
        return f"{head}{'-':>18}{'-':>12}{'-':>11}"
    duties = row.duties[sounding]
    period_us = float(np.nanmean(row.periods_s[sounding])) * 1e6
    jitter_ns = float(np.nanmax(row.jitters_s[sounding])) * 1e9
    duty = f"{duties.min():.3f} to {duties.max():.3f}"
    return f"{head}{duty:>18}{period_us:>12.4f}{jitter_ns:>11.1f}"


def _capture_latches_rows(found: CaptureDrives) -> Iterator[str]:
    from haptogram.evidence.captures.findings import is_capture_silent_after

    yield f"{'latch':<7}{'at ms':>12}{'channels':>10}{'within µs':>11}"
    for number, latch in enumerate(found.latches):
        torn = "  torn" if found.is_torn(latch) else ""
        silent = "  silent from here" if is_capture_silent_after(found, number) else ""
        skew_us = found.seconds(latch.skew + found.period) * 1e6
        yield (
            f"{number:<7}{found.seconds(latch.begin) * 1e3:>12.4f}{len(latch.changes):>10}"
            f"{skew_us:>11.1f}{torn}{silent}"
        )
