"""``haptogram conform``: whether a board does what SPEC.md demands, clause by clause."""

from __future__ import annotations

import argparse
import contextlib
import functools
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

if TYPE_CHECKING:
    from haptogram.conformance.access import Access
    from haptogram.conformance.case import Case
    from haptogram.conformance.runner import Progress
    from haptogram.conformance.verdict import SuiteResult

#: Given URL (None: the default board), line rate and seed, returns a board in this program.
Virtual: TypeAlias = "Callable[[str | None, int, int], Access]"

_SCHEME: Final = "haptogram://"
_PULSE: Final = "pulse"
_EXAMPLES: Final = """\
examples:
  haptogram conform
      the virtual board, in virtual time
  haptogram conform --port /dev/ttyACM0 --junit conform.xml --html conform.html
      a board; every case, every byte of what failed
  haptogram conform --spawn ./build/firmware --port-regex 'PTY is (/dev/pts/[0-9]+)'
      a native build on a pty, restarted for the clauses about a reset
  haptogram conform --port /dev/ttyACM0 --clause HG-2 --clause HG-3.4/1
      one chapter and one clause
  haptogram conform --compare a.json b.json --html matrix.html
      two devices side by side
"""


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser], virtual: Virtual) -> None:
    """Add the command; *virtual* makes a board inside this program."""
    from haptogram.conformance.verdict import meaning_table

    conform = commands.add_parser(
        "conform",
        help="judge a board, or a firmware build, by every clause of the protocol",
        description="Run a case or more for every clause of SPEC.md against a board on any serial "
        "URL, a pty, TCP, or the virtual board.  The board is driven at full output: keep clear "
        "of it.",
        epilog=f"{_EXAMPLES}\nverdicts:\n{meaning_table()}\n\nThe exit status is 1 if any case "
        "says so, else 3 if any does, else 0.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    conform.set_defaults(run=functools.partial(run, virtual=virtual))
    _add_board(conform.add_argument_group("board and port"))
    _add_choice(conform.add_argument_group("what is run, and how"))
    _add_results(conform.add_argument_group("result"))


def _add_board(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--port", metavar="URL", help="any pyserial URL [the virtual board, in virtual time]"
    )
    group.add_argument(
        "--link-baud", type=int, default=3_000_000, metavar="BAUD", help="line rate [3000000]"
    )
    group.add_argument("--spawn", metavar="CMD", help="start this program; it says its port")
    group.add_argument(
        "--port-regex", metavar="REGEX", help="finds the port in what --spawn prints, first group"
    )
    group.add_argument("--reset-cmd", metavar="CMD", help="shell command that restarts the board")
    group.add_argument(
        "--boot-timeout", type=float, default=10.0, metavar="S", help="until its port is there [10]"
    )
    for line in ("dtr", "rts"):
        group.add_argument(
            f"--{line}",
            choices=("0", "1", _PULSE),
            help=f"state of {line.upper()}; pulse: a pulse of it restarts the board",
        )


def _add_choice(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--list", action="store_true", help="list the cases and run none")
    group.add_argument(
        "--clause",
        action="append",
        default=[],
        metavar="ID",
        help="only this case, clause (HG-3.4/1), section or chapter (HG-3); may be repeated",
    )
    group.add_argument("--strict", action="store_true", help="a SHOULD that is not met: FAILED")
    group.add_argument(
        "--timeout", type=float, default=1.0, metavar="S", help="how long an answer may take [1]"
    )
    group.add_argument(
        "--seed", type=int, metavar="N", help="of nonces and contents [0; on a port: random]"
    )
    group.add_argument(
        "--repeat", type=int, default=1, metavar="N", help="run each case N times; mixed: FLAKY"
    )
    group.add_argument(
        "--baseline", type=Path, metavar="FILE", help="TOML of failures that are expected"
    )
    group.add_argument("--quiet", action="store_true", help="no progress")


def _add_results(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--junit", type=Path, metavar="FILE", help="write JUnit XML")
    group.add_argument("--json", type=Path, metavar="FILE", help="write JSON")
    group.add_argument("--html", type=Path, metavar="FILE", help="write an HTML page")
    group.add_argument(
        "--write-baseline", type=Path, metavar="FILE", help="write today's failures as expected"
    )
    group.add_argument("--verbose", action="store_true", help="print every case")
    group.add_argument(
        "--compare",
        type=Path,
        nargs="+",
        metavar="JSON",
        help="run nothing: put results of several devices side by side, in --html",
    )


def run(arguments: argparse.Namespace, virtual: Virtual) -> int:
    """Run the cases, write and print the result, and return the exit status."""
    from haptogram.conformance.cases import all_cases, select
    from haptogram.errors import ConfigurationError

    if arguments.compare:
        return _compare(arguments)
    cases = tuple(select(all_cases(), arguments.clause))
    if not cases:
        raise ConfigurationError(f"--clause {' '.join(arguments.clause)}: there is no such case")
    if arguments.list:
        return _list(cases)
    suite = _run_cases(arguments, cases, virtual)
    _write(arguments, suite)
    from haptogram.conformance.reports.text import render

    print(render(suite, verbose=arguments.verbose))
    return suite.exit_status


def _run_cases(
    arguments: argparse.Namespace, cases: tuple[Case, ...], virtual: Virtual
) -> SuiteResult:
    from haptogram.conformance.baseline import load_baseline
    from haptogram.conformance.cases import all_cases
    from haptogram.conformance.runner import Options, Runner
    from haptogram.errors import ConfigurationError

    for name, least in (("timeout", 0.001), ("repeat", 1), ("link_baud", 1), ("boot_timeout", 0)):
        if getattr(arguments, name) < least:
            option = name.replace("_", "-")
            raise ConfigurationError(f"--{option} is {getattr(arguments, name)}; least is {least}")
    expected = load_baseline(arguments.baseline, all_cases()) if arguments.baseline else {}
    options = Options(
        timeout_s=arguments.timeout,
        seed=_seed(arguments),
        repeat=arguments.repeat,
        strict=arguments.strict,
        expected=expected,
    )
    with _progress(quiet=arguments.quiet) as progress:
        return Runner(_access(arguments, virtual), options, progress).run(cases)


def _is_virtual(arguments: argparse.Namespace) -> bool:
    if arguments.spawn:
        return False
    return arguments.port is None or arguments.port.startswith(_SCHEME)


def _seed(arguments: argparse.Namespace) -> int:
    """Return the seed; on a port another one each time, lest a nonce be the one still open."""
    if arguments.seed is not None:
        return int(arguments.seed)
    return 0 if _is_virtual(arguments) else int.from_bytes(os.urandom(4))


def _access(arguments: argparse.Namespace, virtual: Virtual) -> Access:
    from haptogram.conformance.access import DEFAULT_PORT_REGEX, PortAccess, SpawnAccess
    from haptogram.errors import ConfigurationError

    if arguments.spawn and arguments.port:
        raise ConfigurationError("--spawn names its own port: --port is one too many")
    if arguments.spawn:
        return SpawnAccess(
            arguments.spawn,
            port_regex=arguments.port_regex or DEFAULT_PORT_REGEX,
            boot_timeout_s=arguments.boot_timeout,
            baudrate=arguments.link_baud,
        )
    if _is_virtual(arguments):
        return virtual(arguments.port, arguments.link_baud, _seed(arguments))
    lines = {"dtr": arguments.dtr, "rts": arguments.rts}
    held = {name: state == "1" for name, state in lines.items() if state in ("0", "1")}
    return PortAccess(
        arguments.port,
        baudrate=arguments.link_baud,
        reset_command=arguments.reset_cmd,
        boot_timeout_s=arguments.boot_timeout,
        dtr=held.get("dtr"),
        rts=held.get("rts"),
        pulse=next((name for name, state in lines.items() if state == _PULSE), None),
    )


@contextlib.contextmanager
def _progress(*, quiet: bool) -> Iterator[Progress | None]:
    """Show on standard error which case runs."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    tqdm.monitor_interval = 0
    with tqdm(desc="conform", unit=" cases", leave=False, dynamic_ncols=True) as bar:

        def show(done: int, total: int, name: str) -> None:
            bar.total = total
            bar.set_postfix_str(name, refresh=False)
            bar.update(done - bar.n)

        yield show


def _list(cases: tuple[Case, ...]) -> int:
    for case in cases:
        kind = "" if case.body else " (not observable)"
        print(f"{case.id:<20} {case.evidence:<14} {case.what}{kind}")
    return 0


def _compare(arguments: argparse.Namespace) -> int:
    from haptogram.conformance.reports.machine import read_json
    from haptogram.conformance.reports.page import write_matrix
    from haptogram.errors import ConfigurationError

    if arguments.html is None:
        raise ConfigurationError("--compare writes a page: name it with --html")
    write_matrix(arguments.html, [read_json(path) for path in arguments.compare])
    print(f"wrote {arguments.html}", file=sys.stderr)
    return 0


def _write(arguments: argparse.Namespace, suite: SuiteResult) -> None:
    from haptogram.conformance.baseline import write_baseline
    from haptogram.conformance.reports.machine import write_json, write_junit
    from haptogram.conformance.reports.page import write_page

    for path, write in (
        (arguments.json, write_json),
        (arguments.junit, write_junit),
        (arguments.html, write_page),
        (arguments.write_baseline, write_baseline),
    ):
        if path is not None:
            write(path, suite)
            print(f"wrote {path}", file=sys.stderr)
