"""The account of a soak as a document."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import Final

from haptogram.campaigns.soak.campaign import SoakCampaign
from haptogram.campaigns.soak.tally import MEMORY_GREW, STATES, VIOLATIONS, SoakTally

from ..formats import document

_FAULT_HEAD: Final = ("fault", "injected", "detected", "harmless", "found as")
_COURSE_HEAD: Final = (
    "until (min)",
    "frames",
    "damaged",
    "lost",
    "late",
    "latest (ms)",
    "violations",
)
_STEP_COUNTS: Final = ("frames", "damaged", "lost", "late", "violations")
_MOST_STEPS: Final = 12
_COUNTER_HEAD: Final = ("counter", "board", "explained by")

_COUNTED: Final = (  # {s}: of a plural
    ("frames", "stream frame{s}"),
    ("latched", "latched, each compared code by code with what was sent"),
    ("sessions", "session{s}"),
    ("pauses", "pause{s}"),
    ("outages", "outage{s}"),
    ("mutes", "MUTE in the midst of the stream"),
    ("restarts", "session{s} begun in the midst of the stream"),
    ("muted by a timer", "mute{s} by a timer, each within its limit"),
    ("clock steps", "step{s} of the board's clock"),
)
_TRAFFIC: Final = {
    "dropped_state": "stream frames that came while the board was not armed",
    "accepted": "taken into the queue: latched, flushed, or still waiting",
    "frames": "undamaged frames that came",
    "flushed": "waiting when MUTE or a new session came",
    "latched": "each one above",
    "repeated": "copies of requests: duplicates, and what the host asked again",
    "requests": "those of the host",
    "timeouts": "mutes by a timer",
}


def soak_document(campaign: SoakCampaign) -> document.Document:
    """Return the account of *campaign*: its violations, its faults, its totals."""
    sentence, tally = _soak_sentence(campaign), campaign.tally
    verdict = sentence.partition(":")[0].partition(",")[0]
    setup = campaign.setup.as_dict().items()
    properties = {name: str(value) for name, value in setup if value is not None}
    totals = {f"totals.{name}": str(n) for name, n in sorted(tally.totals.items())}
    faults, counters = _soak_fault_rows(tally), list(_soak_counter_rows(tally))
    return document.Document(
        command="soak",
        heading=sentence,
        title=f"soak, {verdict.lower()}",
        tone=document.TONES[verdict.lower()],
        findings=list(_soak_findings(campaign)),
        lead=list(_soak_conditions(campaign)),
        sections=[
            document.Section("Course", _soak_course(campaign)),
            document.Section(
                "Faults, and how they were found",
                [document.Table(_FAULT_HEAD, faults, (1, 2, 3), (4,))] if faults else [],
            ),
            document.Section("Totals", [document.Table((), _soak_total_rows(tally), (0,))]),
            document.Section(
                "Counters of the board, and the faults that explain them",
                [document.Table(_COUNTER_HEAD, counters, (1,), (2,))] if counters else [],
            ),
        ],
        checks=list(_soak_checks(campaign)),
        properties=properties | totals,
        seconds=campaign.spent_s,
    )


def _soak_findings(campaign: SoakCampaign) -> Iterator[document.Finding]:
    """Yield errors: each violation kept, a soak without a whole segment, and memory that grew."""
    for example in campaign.tally.examples:
        yield document.Finding(document.Level.ERROR, *example.split(": ", 1))
    if not campaign.done:
        yield document.Finding(document.Level.ERROR, "segments", _soak_sentence(campaign))
    if MEMORY_GREW in campaign.failures:
        yield document.Finding(document.Level.ERROR, "memory", _soak_memory(campaign))


def _soak_course(campaign: SoakCampaign) -> list[document.Block]:
    """Return a table of a soak's counts in up to 12 steps of time; [] if there are none.

    The lateness of the latest frame is in ms.
    """
    course, interval_s = campaign.tally.course, campaign.setup.interval_s
    if not course:
        return []
    step = math.ceil((max(course) + 1) / _MOST_STEPS)
    rows = []
    for begin in range(0, max(course) + 1, step):
        parts = [course[number] for number in range(begin, begin + step) if number in course]
        frames, damaged, lost, late, wrong = (
            str(sum(part[name] for part in parts)) for name in _STEP_COUNTS
        )
        latest_ms = max((part["latest_us"] for part in parts), default=0) / 1e3
        end_min = min((begin + step) * interval_s, campaign.setup.seconds) / 60
        rows.append((f"{end_min:.2f}", frames, damaged, lost, late, f"{latest_ms:.1f}", wrong))
    return [
        document.Table(_COURSE_HEAD, rows, range(len(_COURSE_HEAD))),
        document.Listing(
            [
                "Damaged frames are those that either end found; lost and late ones are those to "
                "the board. A frame is late by the time from its due time to its arrival."
            ]
        ),
    ]


def _soak_sentence(campaign: SoakCampaign) -> str:
    """Return the verdict and its reason; inconclusive if no segment came to its end."""
    if not campaign.done:
        return "INCONCLUSIVE: no segment came to its end, so nothing was judged"
    if campaign.failures:
        return "FAIL: " + ", ".join(f"{name} ({n})" for name, n in campaign.failures.items())
    whole = "" if campaign.is_complete else ", so far"
    return (
        f"PASS{whole}: no damaged frame and no torn drive was latched, the output was off in "
        "time, and everything that was injected is accounted for"
    )


def _soak_conditions(campaign: SoakCampaign) -> Iterator[str]:
    """Yield duration, seed and rate of faults, then speed and memory."""
    setup = campaign.setup
    yield (
        f"{campaign.done_s / 3600:.3f} of {setup.hours:g} virtual hours "
        f"({campaign.done} of {setup.segments} segments), seed {setup.seed}, "
        f"{setup.fault_rate:g} of the frames hit, 1 kHz"
    )
    yield f"speed: {campaign.times_real_time:.1f} times real time; {_soak_memory(campaign)}"


def _soak_memory(campaign: SoakCampaign) -> str:
    """Return the growth of the processes' memory as text in MiB, or that it did not grow."""
    grown = f"{campaign.memory.growth_bytes / 2**20:.1f}"
    return "memory did not grow" if float(grown) <= 0.0 else f"memory grew by {grown} MiB"


def _soak_total_rows(tally: SoakTally) -> list[tuple[str, str]]:
    """Return count and name of everything that was streamed and done."""
    counts = ((tally.totals[name], text) for name, text in _COUNTED)
    return [(str(count), text.format(s="" if count == 1 else "s")) for count, text in counts]


def _soak_fault_rows(tally: SoakTally) -> list[tuple[str, ...]]:
    """Return a row for each kind of fault: injected, detected, harmless, and how it was found.

    Columns are those of :data:`_FAULT_HEAD`.
    """
    rows = []
    for kind, found in tally.found().items():
        counts = (str(tally.faults[kind][state]) for state in STATES)
        rows.append((kind, *counts, ", ".join(f"{name} {n}" for name, n in found.items())))
    return rows


def _soak_counter_rows(tally: SoakTally) -> Iterator[tuple[str, str, str]]:
    """Yield each counter of the board that is not 0, its value, and the faults behind it."""
    by_name: dict[str, Counter[str]] = {}
    for kind, found in tally.found().items():
        for name, count in found.items() if kind.startswith("down.") else ():
            by_name.setdefault(name, Counter())[kind.removeprefix("down.")] += count
    for name, total in sorted(tally.totals.items()):
        counter = name.removeprefix("counter ")
        if counter != name and total:
            faults = by_name.get(counter, Counter()).most_common()
            causes = _TRAFFIC.get(counter) or ", ".join(f"{k} {n}" for k, n in faults)
            yield counter, str(total), causes


def _soak_checks(campaign: SoakCampaign) -> Iterator[document.Check]:
    """Yield a check for each kind of violation, and one that the soak came to its end.

    Without a whole segment a violation that did not occur is not judged.
    """
    for name, statement in VIOLATIONS.items():
        count = campaign.failures.get(name, 0)
        examples: list[str] = []
        if count:
            outcome = document.Outcome.FAILED
            message = f"{name}: {count} times" if count > 1 else f"{name}: once"
            examples = [text for text in campaign.tally.examples if f", {name}: " in text]
            examples += [_soak_memory(campaign)] if name == MEMORY_GREW else []
        elif campaign.done:
            outcome = document.Outcome.PASSED
            message = f"{name}: never, in {campaign.done_s:g} s of virtual time"
        else:
            outcome, message = document.Outcome.NOT_JUDGED, "no segment came to its end"
        yield document.Check("violations", statement, outcome, message, examples, name)
    message = f"{campaign.done} of {campaign.setup.segments} segments"
    outcome = document.Outcome.PASSED if campaign.is_complete else document.Outcome.INCONCLUSIVE
    statement = "the soak comes to its end"
    seconds = campaign.spent_s
    yield document.Check("segments", statement, outcome, message, kind="cut short", seconds=seconds)
