"""The account of a soak in words and rows, for terminal, page and summary alike."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Final

from haptogram.campaigns.soak.campaign import SoakCampaign
from haptogram.campaigns.soak.tally import STATES, SoakTally

FAULT_HEAD: Final = ("fault", "injected", "detected", "harmless", "found as")
COUNTER_HEAD: Final = ("counter", "board", "explained by")
COUNTER_SENTENCE: Final = "counters of the board, and the faults that explain them:"

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
    "accepted": "taken into the queue: latched, flushed, or still waiting",
    "frames": "undamaged frames that came",
    "flushed": "waiting when MUTE or a new session came",
    "latched": "each one above",
    "repeated": "copies of requests: duplicates, and what the host asked again",
    "requests": "those of the host",
    "timeouts": "mutes by a timer",
}


def soak_sentence(campaign: SoakCampaign) -> str:
    """Return the verdict and its reason."""
    if not campaign.done:
        return "INCONCLUSIVE: no segment came to its end, so nothing was judged"
    if campaign.failures:
        return "FAIL: " + ", ".join(f"{name} ({n})" for name, n in campaign.failures.items())
    whole = "" if campaign.is_complete else ", so far"
    return (
        f"PASS{whole}: no damaged frame and no torn drive was latched, the output was off in "
        "time, and everything that was injected is accounted for"
    )


def soak_conditions(campaign: SoakCampaign) -> Iterator[str]:
    """Yield duration, seed and rate of faults, then speed and memory."""
    setup = campaign.setup
    yield (
        f"{campaign.done_s / 3600:.3f} of {setup.hours:g} virtual hours "
        f"({campaign.done} of {setup.segments} segments), seed {setup.seed}, "
        f"{setup.fault_rate:g} of the frames hit, 1 kHz"
    )
    yield f"speed: {campaign.times_real_time:.1f} times real time; {soak_memory(campaign)}"


def soak_memory(campaign: SoakCampaign) -> str:
    """Return the growth of the memory of the processes."""
    grown = f"{campaign.memory.growth_bytes / 2**20:.1f}"
    return "memory did not grow" if float(grown) <= 0.0 else f"memory grew by {grown} MiB"


def soak_total_rows(tally: SoakTally) -> list[tuple[str, str]]:
    """Return count and name of everything that was streamed and done."""
    counts = ((tally.totals[name], text) for name, text in _COUNTED)
    return [(str(count), text.format(s="" if count == 1 else "s")) for count, text in counts]


def soak_fault_rows(tally: SoakTally) -> list[tuple[str, ...]]:
    """Return a row for each kind of fault, under :data:`FAULT_HEAD`."""
    rows = []
    for kind, found in tally.found().items():
        counts = (str(tally.faults[kind][state]) for state in STATES)
        rows.append((kind, *counts, ", ".join(f"{name} {n}" for name, n in found.items())))
    return rows


def soak_counter_rows(tally: SoakTally) -> Iterator[tuple[str, str, str]]:
    """Yield the board's counters, each with the faults that explain it."""
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
