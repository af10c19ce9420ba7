"""The command ``ci/trials``: thousands of trials in parallel, resumable, with their result."""

from __future__ import annotations

import argparse
import dataclasses
import json
import re
import signal
import sys
import traceback
import warnings
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from itertools import islice, zip_longest
from pathlib import Path
from typing import Any, Final, NoReturn

from tqdm import tqdm

from haptogram.campaigns.sweep.workers import process_workers

from . import cases, chain, judging
from .cases import Group
from .judging import BAD, Trial
from .results import GROUPS, Line, counted, document, findings, is_good, summary, table, told

_VERSION: Final = 1
_AHEAD: Final = 3  # sessions that wait for each process
_SEEDS: Final = 1_000_000  # of sessions, for each seed of a campaign
_LAST_SEED: Final = (1 << 32) // _SEEDS - 1  # a board has one of 32 bits
_CASE: Final = re.compile(r"(honest|wrong):(\d+):(\d+)")
USAGE: Final = 2
INTERRUPTED: Final = 130

_DESCRIPTION: Final = """\
Is the verdict ever wrong?  Each trial is one frame that goes from the driver over bytes to the
virtual board, in virtual time, and is judged by the program; beside it, a field and a search that
share no code with the program find where the focus really is.  Array, pose, aperture, foci, air,
calibration, tolerance and fault are drawn at random.

  honest trials   correct frames: a verdict that fails one is a false fail
  wrong trials    wrong drives, faults and poses: a verdict that passes one, although its effect is
                  larger than the verdict says that it would have shown, is a false pass

A session has {frames} frames.  20 000 trials take about a quarter of an hour on two idle cores.
"""
_EXAMPLES: Final = """\
examples:
  ci/trials --honest 100 --wrong 100
      a first look, in half a minute
  ci/trials --resume out/trials.jsonl
      all of them; Ctrl-C interrupts, the same command goes on where it stopped
  ci/trials --resume out/trials.jsonl --table docs/trials.md
      the same, then the page with the table
  ci/trials --case wrong:1000017:3
      one trial again, with array, drive, verdict and truth: each finding ends in such a command

exit status:
  0  no verdict was wrong
  1  a verdict was wrong, the program crashed, or too many frames were not verified
  2  usage                    130  interrupted
"""


# --- one session -----------------------------------------------------------------------------


def trials_of(group: Group, seed: int) -> list[Trial]:
    """Run one session and judge its frames; an error of these trials is a crash as well."""
    session = cases.session_of(group, seed)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return judging.judged(*chain.run_session(session))
    except Exception:
        last = traceback.format_exc().strip().splitlines()
        why = f"{last[-1]} [{' '.join(last[-3].split())}]"
        return [
            Trial(f"{group}:{seed}:{place}", "the trials themselves", "crash", "-", [why])
            for place in range(len(session.frames))
        ]


def line_of(job: tuple[Group, int]) -> Line:
    group, seed = job
    return {
        "group": group,
        "seed": seed,
        "trials": [dataclasses.asdict(trial) for trial in trials_of(group, seed)],
    }


# --- the file --------------------------------------------------------------------------------


class Book:
    """The finished sessions, in memory and in a file from which a run resumes.

    Raises
    ------
    SystemExit
        If the file holds trials of another seed or version.
    """

    def __init__(self, path: Path | None, seed: int) -> None:
        self._path = path
        self._done: dict[tuple[Group, int], Line] = {}
        self._file = None
        if path is None:
            return
        head = {"trials": _VERSION, "seed": seed, "frames": cases.FRAMES}
        kept = _whole_lines(path)
        if kept and kept[0] != head:
            refuse(f"{path} holds other trials: {kept[0]}, not {head}; name another file")
        for line in kept[1:]:
            self._done[line["group"], line["seed"]] = line
        path.parent.mkdir(parents=True, exist_ok=True)
        # Written anew, because an interruption may have cut the last line.
        temporary = path.with_suffix(".part")
        temporary.write_text("".join(json.dumps(line) + "\n" for line in kept or [head]))
        temporary.replace(path)
        self._file = path.open("a", encoding="utf-8")

    def add(self, line: Line) -> None:
        self._done[line["group"], line["seed"]] = line
        if self._file is not None:
            self._file.write(json.dumps(line) + "\n")
            self._file.flush()

    def get(self, group: Group, seed: int) -> Line | None:
        return self._done.get((group, seed))

    def close(self) -> None:
        if self._file is not None:
            self._file.close()


def _whole_lines(path: Path) -> list[Line]:
    if not path.exists():
        return []
    found = []
    for text in path.read_text(encoding="utf-8").splitlines():
        try:
            found.append(json.loads(text))
        except ValueError:
            break
    return found


# --- many ------------------------------------------------------------------------------------


def first_seed(seed: int) -> int:
    return seed * _SEEDS


def sessions(book: Book, group: Group, seed: int, wanted: int) -> tuple[list[Line], int, int]:
    """Return the finished sessions of a group in order, their number of trials, the next seed.

    Sessions count from the first seed without a gap, up to the wanted number of trials, so that the
    result does not depend on which process was faster.
    """
    lines, trials, at = [], 0, first_seed(seed)
    while trials < wanted and (line := book.get(group, at)) is not None:
        lines.append(line)
        trials += sum(counted(trial) for trial in line["trials"])
        at += 1
    return lines, trials, at


def run(book: Book, seed: int, wanted: dict[Group, int], jobs: int, bar: tqdm[Any]) -> None:
    """Run the missing sessions."""
    running: dict[Future[Line], tuple[Group, int]] = {}
    with process_workers(jobs) as workers:
        while True:
            for job in _missing(book, seed, wanted, jobs * _AHEAD, set(running.values())):
                running[workers.executor.submit(line_of, job)] = job
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                del running[future]
                line = future.result()
                book.add(line)
                _tell(bar, line)


def _missing(
    book: Book, seed: int, wanted: dict[Group, int], ahead: int, running: set[tuple[Group, int]]
) -> Iterator[tuple[Group, int]]:
    """Return the next sessions, of both groups in turn, beginning with the less busy group."""
    groups = sorted(GROUPS, key=[group for group, _ in running].count)
    queues = [_missing_of(book, group, seed, wanted[group], running) for group in groups]
    in_turn = (job for jobs in zip_longest(*queues) for job in jobs if job is not None)
    return islice(in_turn, max(0, ahead - len(running)))


def _missing_of(
    book: Book, group: Group, seed: int, wanted: int, running: set[tuple[Group, int]]
) -> Iterator[tuple[Group, int]]:
    _, trials, at = sessions(book, group, seed, wanted)
    while trials < wanted and at < first_seed(seed + 1):
        if book.get(group, at) is None and (group, at) not in running:
            yield group, at
        trials += cases.FRAMES  # an estimate for a session that runs
        at += 1


def _tell(bar: tqdm[Any], line: Line) -> None:
    bar.update(sum(counted(trial) for trial in line["trials"]))
    said = set()
    for trial in line["trials"]:  # a refused session is reported once, not for every frame
        if trial["outcome"] in BAD and str(trial["findings"]) not in said:
            said.add(str(trial["findings"]))
            bar.write(told(trial))


# --- the command -----------------------------------------------------------------------------


def main(arguments: list[str] | None = None) -> int:
    """Run; return 0 only if no verdict was wrong, none crashed and few were not verified."""
    options = _parser().parse_args(arguments)
    if options.case is not None:
        return replay(options.case)
    wanted: dict[Group, int] = {"honest": options.honest, "wrong": options.wrong}
    book = Book(options.resume, options.seed)
    for number in (signal.SIGINT, signal.SIGTERM):  # a shell may have had them ignored
        signal.signal(number, signal.default_int_handler)
    there = sum(min(sessions(book, g, options.seed, wanted[g])[1], wanted[g]) for g in GROUPS)
    try:
        with tqdm(total=sum(wanted.values()), initial=there, unit="trial", smoothing=0.05) as bar:
            run(book, options.seed, wanted, options.jobs, bar)
    except KeyboardInterrupt:
        where = "" if options.resume is None else f"; go on with --resume {options.resume}"
        sys.stderr.write(f"ci/trials: interrupted{where}\n")
        return INTERRUPTED
    finally:
        book.close()
    trials = {g: trials_in(sessions(book, g, options.seed, wanted[g])[0]) for g in GROUPS}
    _report(trials, options.show)
    if options.table is not None:
        options.table.write_text(document(options.seed, trials), encoding="utf-8")
    return 0 if is_good(trials) else 1


def trials_in(lines: list[Line]) -> list[Line]:
    return [trial for line in lines for trial in line["trials"]]


def _report(trials: dict[Group, list[Line]], shown: int) -> None:
    for group in GROUPS:
        _say(f"\n{table(trials[group])}\n")
        _say("\n".join(summary(group, trials[group])))
    everything = [trial for group in GROUPS for trial in trials[group]]
    if lines := findings(everything, shown):
        _say("\nfindings:")
        _say("\n".join(lines))


def replay(case: str) -> int:
    """Run the session of one case again and print array, drive, verdict and truth."""
    match = _CASE.fullmatch(case)
    if match is None or int(match[3]) >= cases.FRAMES:
        refuse(
            f"--case is {case!r}, must be honest:SEED:FRAME or wrong:SEED:FRAME with a FRAME "
            f"below {cases.FRAMES}"
        )
    group: Group = "honest" if match[1] == "honest" else "wrong"
    session = cases.session_of(group, int(match[2]))
    ran, program = chain.run_session(session)
    place = int(match[3])
    trial = judging.judged(ran, program)[place]
    layout = session.layout
    _say(f"array      {layout.name}, {layout.count} elements, pitch {layout.pitch_m * 1e3:g} mm")
    _say(f"session    {session.mode}, {session.temperature_c:.3f} C")
    _say(f"           {ran.tags}, {session.allowance}, {session.host}")
    _say(f"wanted     {session.frames[place]}")
    if place < len(ran.frames):
        seen = ran.frames[place]
        if seen.wrong is not None:
            _say(f"wrong      {seen.wrong.kind}, {seen.wrong.size:.6g}")
        _say(f"verdict    {seen.verdict}")
    _say(f"truth      {trial.numbers}")
    _say(f"outcome    {trial.outcome}: {'; '.join(trial.findings) or 'nothing to say'}")
    return 1 if trial.outcome in BAD else 0


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ci/trials",
        description=_DESCRIPTION.format(frames=cases.FRAMES),
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = parser.add_argument
    add("--honest", type=_count, default=10_000, metavar="N", help="correct frames [%(default)s]")
    add("--wrong", type=_count, default=10_000, metavar="N", help="wrong frames [%(default)s]")
    add("--seed", type=_seed, default=1, metavar="N", help="seed of all trials [%(default)s]")
    add("--jobs", type=_count, default=2, metavar="N", help="processes [%(default)s]")
    add("--resume", type=Path, metavar="FILE", help="keep finished sessions in FILE, skip those")
    add("--table", type=Path, metavar="FILE", help="write the result as Markdown")
    add("--show", type=_count, default=3, metavar="N", help="examples of a finding [%(default)s]")
    add("--case", metavar="GROUP:SEED:FRAME", help="run this one trial again and print all of it")
    return parser


def _count(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 0 on")
    return int(text)


def _seed(text: str) -> int:
    if (seed := _count(text)) > _LAST_SEED:
        raise argparse.ArgumentTypeError(f"{text!r} is above {_LAST_SEED}")
    return seed


def refuse(text: str) -> NoReturn:
    """Leave with a usage error."""
    sys.stderr.write(f"ci/trials: {text}\n")
    raise SystemExit(USAGE)


if __name__ == "__main__":
    sys.exit(main())
