"""The account of a soak as text for a terminal."""

from __future__ import annotations

from collections import Counter

from haptogram.campaigns.soak.campaign import SoakCampaign
from haptogram.campaigns.soak.tally import SoakTally

from .console import console_table

_COUNTED: tuple[tuple[str, str], ...] = (  # {s}: of a plural
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
_TRAFFIC: dict[str, str] = {
    "frames": "undamaged frames that came",
    "flushed": "waiting when MUTE or a new session came",
    "latched": "each one above",
    "repeated": "copies of requests: duplicates, and what the host asked again",
    "requests": "those of the host",
    "timeouts": "mutes by a timer",
}


def soak_text(campaign: SoakCampaign) -> str:
    """Return totals, the faults of every kind and how they were found, counters and verdict."""
    return "\n".join(
        [
            *_head(campaign),
            "",
            *_totals(campaign.tally),
            "",
            *_faults(campaign.tally),
            "",
            *_counters(campaign.tally),
            "",
            *_verdict(campaign),
        ]
    )


def _head(campaign: SoakCampaign) -> list[str]:
    setup = campaign.setup
    what = f"seed {setup.seed}, {setup.fault_rate:g} of the frames hit, 1 kHz"
    grown = f"{campaign.memory.growth_bytes / 2**20:.1f}"
    memory = "did not grow" if float(grown) <= 0.0 else f"grew by {grown} MiB"
    return [
        f"soak: {campaign.done_s / 3600:.3f} of {setup.hours:g} virtual hours "
        f"({campaign.done} of {setup.segments} segments), {what}",
        f"speed: {campaign.times_real_time:.1f} times real time; memory {memory}",
    ]


def _totals(tally: SoakTally) -> list[str]:
    counts = ((tally.totals[name], text) for name, text in _COUNTED)
    return [f"{count:>12} {text.format(s='' if count == 1 else 's')}" for count, text in counts]


def _faults(tally: SoakTally) -> list[str]:
    """Return a table of the kinds of faults: how many were injected, detected and harmless."""
    rows = []
    for kind, count in sorted(tally.injected.items()):
        found = ", ".join(
            f"{name} {n}" for (k, name), n in sorted(tally.outcomes.items()) if k == kind
        )
        rows.append((kind, count, tally.detected[kind], tally.harmless[kind], found))
    head = ("fault", "injected", "detected", "harmless", "found as")
    return console_table(head, rows, numbers=(1, 2, 3))


def _counters(tally: SoakTally) -> list[str]:
    """Return the board's counters, each with the faults that explain it."""
    by_name: dict[str, Counter[str]] = {}
    for (kind, name), count in tally.outcomes.items():
        if kind.startswith("down."):
            by_name.setdefault(name, Counter())[kind.removeprefix("down.")] += count
    lines = ["counters of the board, and the faults that explain them:"]
    for name, total in sorted(tally.totals.items()):
        counter = name.removeprefix("counter ")
        if counter != name and total:
            faults = by_name.get(counter, Counter()).most_common()
            causes = _TRAFFIC.get(counter) or ", ".join(f"{k} {n}" for k, n in faults)
            lines.append(f"{counter:>16} {total:>10}  {causes}".rstrip())
    return lines


def _verdict(campaign: SoakCampaign) -> list[str]:
    failures = campaign.failures
    if not campaign.done:
        return ["INCONCLUSIVE: no segment came to its end, so nothing was judged"]
    if not failures:
        whole = "" if campaign.is_complete else ", so far"
        return [
            f"PASS{whole}: no damaged frame and no torn drive was latched, the output was off in "
            "time, and everything that was injected is accounted for"
        ]
    names = ", ".join(f"{name} ({count})" for name, count in failures.items())
    return [f"FAIL: {names}", *(f"  {text}" for text in campaign.tally.examples)]
