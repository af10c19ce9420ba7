"""What trials came to: tables, sums, findings, and the page of the documentation."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable
from typing import Any, Final

from .cases import Group
from .judging import BAD

GROUPS: Final[tuple[Group, ...]] = ("honest", "wrong")
#: Of the frames that show everything: how many may stay unverified, as a share.
MOST_SILENT: Final = 0.02
#: Families of fewer trials share a row of the page.
_COMMON: Final = 800
_NUMBER: Final = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")

Line = dict[str, Any]  # a trial as it lies in the file


def counted(trial: Line) -> bool:
    """Whether it is one of those that were asked for: a frame that a fault left alone is not."""
    return trial["case"].startswith("honest") or trial["outcome"] not in ("passed", "stopped")


def told(trial: Line) -> str:
    why = "; ".join(trial["findings"])
    return f"{trial['outcome']}: {trial['kind']}: {why}    ci/trials --case {trial['case']}"


_COLUMNS: Final = {
    "passed": ("passed",),
    "caught": ("caught",),
    "below": ("below, passed", "below, failed"),
    "not verified": ("not verified",),
    "lost": ("lost", "stopped"),
    "wrong verdict": BAD,
}


def family(kind: str) -> str:
    """The kinds that the page sums: a layout, a way to be wrong, or where a fault sits."""
    name = kind.removesuffix(" (host)").removesuffix(" (line)")
    if re.match(r"(clock|device|frame|line)\.", name):
        return f"faults of the {name.partition('.')[0]}"
    name = re.sub(r"^(off by) \d+ steps$", r"\1 some steps", name)
    return re.sub(r"(?:[:,]| small\b| [xy]$).*", "", name)


def table(trials: Iterable[Line], *, summed: bool = False) -> str:
    """A row per kind of case, or per family of kinds, in Markdown."""
    rows: dict[str, Counter[str]] = defaultdict(Counter)
    for trial in trials:
        rows[family(trial["kind"]) if summed else trial["kind"]][trial["outcome"]] += 1
    if summed:
        rows = _with_rare_ones_together(rows)
    head = ["case", "trials", *_COLUMNS]
    body = [_row(kind, rows[kind]) for kind in sorted(rows)]
    body.append(_row("**all**", sum(rows.values(), Counter())))
    lines = [head, ["---"] + ["---:"] * (len(head) - 1), *body]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def _with_rare_ones_together(rows: dict[str, Counter[str]]) -> dict[str, Counter[str]]:
    """The families, those of few trials in one row."""
    common = {name: counts for name, counts in rows.items() if counts.total() >= _COMMON}
    rare = sum((counts for name, counts in rows.items() if name not in common), Counter[str]())
    return common | ({"others": rare} if rare else {})


def _row(kind: str, counts: Counter[str]) -> list[str]:
    cells = [sum(counts[name] for name in names) for names in _COLUMNS.values()]
    return [kind, str(sum(counts.values())), *(str(cell) if cell else "" for cell in cells)]


def summary(group: Group, trials: list[Line]) -> list[str]:
    """What a group came to, and what that means."""
    count = Counter(trial["outcome"] for trial in trials)
    n = sum(counted(trial) for trial in trials)
    bad = {name: count[name] for name in BAD}
    lines = [f"{group}: {n} trials: " + ", ".join(f"{many} x {name}" for name, many in bad.items())]
    if n and not any(bad.values()):
        lines.append(f"0 of {n}: with 95 % confidence below {100 * 3 / n:.2g} % of such cases")
    if group == "honest" and n:
        lines += _silence(trials)
    return lines + _unnamed(trials)


def _unnamed(trials: list[Line]) -> list[str]:
    """What the codes of a board prove to be wrong, and the verdict tells by no name or place."""
    shown = [t for t in trials if t["outcome"] == "caught" and t["kind"].endswith("(line)")]
    shown = [t for t in shown if "named" in t["numbers"]]
    bare = Counter(t["kind"] for t in shown if not t["numbers"]["named"])
    if not shown:
        return []
    kinds = ", ".join(f"{many} x {kind[:-7]}" for kind, many in bare.most_common())
    return [f"drives that are not those sent: {len(shown)} caught, {bare.total()} without a name "
            "or a place" + (f" ({kinds})" if kinds else "")]  # fmt: skip


def silent(trials: list[Line]) -> list[Line]:
    """Honest frames that were not verified although the array can show everything."""
    return [t for t in trials if t["outcome"] == "not verified" and t["numbers"].get("observable")]


def _silence(trials: list[Line]) -> list[str]:
    unverified = [trial for trial in trials if trial["outcome"] == "not verified"]
    share = len(silent(trials)) / len(trials)
    lines = [
        f"not verified: {len(unverified)}, of them {len(silent(trials))} ({100 * share:.2g} %) "
        "although every direction can be observed"
    ]
    for kind in ("one focus", "several foci"):
        of_kind = [trial for trial in trials if kind in trial["kind"]]
        count = sum(trial["outcome"] == "not verified" for trial in of_kind)
        lines.append(f"{kind}, on arrays of any size: {len(of_kind)} trials, {count} not verified")
    reasons = Counter(_NUMBER.sub("#", str(t["numbers"].get("note"))) for t in unverified)
    return lines + [f"  {many} x {reason}" for reason, many in reasons.most_common()]


def findings(trials: Iterable[Line], shown: int) -> list[str]:
    """Every kind of finding, how often, and the first of them with what replays it."""
    found: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for trial in trials:
        for text in trial["findings"]:
            kind = f"[{trial['outcome']}] " + _NUMBER.sub("#", text)
            found[kind].append((text, trial["case"]))
    lines = []
    for kind, them in sorted(found.items(), key=lambda item: -len(item[1])):
        lines.append(f"{len(them)} x {kind}")
        lines += [f"    {text}    ci/trials --case {case}" for text, case in them[:shown]]
    return lines


def is_good(trials: dict[Group, list[Line]]) -> bool:
    """Whether nothing was wrong, and nothing was silent that should have spoken."""
    everything = [trial for group in GROUPS for trial in trials[group]]
    if any(trial["outcome"] in BAD for trial in everything):
        return False
    if any(text.startswith("silent") for trial in everything for text in trial["findings"]):
        return False
    honest = trials["honest"]
    return len(silent(honest)) <= MOST_SILENT * len(honest)


def document(seed: int, trials: dict[Group, list[Line]]) -> str:
    """The page of the documentation."""
    many = {group: sum(map(counted, trials[group])) for group in GROUPS}
    parts = [_PAGE_HEAD.format(seed=seed, **many)]
    for group in GROUPS:
        parts += [f"## {_TITLES[group]}", "", table(trials[group], summed=True), ""]
        parts += [f"- {line}" for line in summary(group, trials[group]) if line[0] != " "]
        parts.append("")
    return "\n".join(parts)


_TITLES: Final = {"honest": "Correct drives", "wrong": "Wrong drives and faults"}
_PAGE_HEAD: Final = """\
# Is the verdict ever wrong?

Written by `ci/trials --seed {seed}`, of {honest} correct and {wrong} wrong frames, which go
from the driver over bytes to the virtual board. The truth beside each shares no code with the
program: a field and a search of its own. Families of fewer than 800 trials are *others*.

- *False pass*: on target, although the effect exceeds what the verdict says that it would show.
- *False fail*: a correct frame that fails. With a tolerance, a correct host takes up to all of it:
  another place, other air, elements a little elsewhere, all at once.
- *Below*: wrong drives whose effect is smaller than what shows.
- *Wrong verdict*: a false pass, a false fail or a crash.
- *Lost*: not latched because of a fault, or never sent because the fault ended the run.
- *Passed* among the wrong ones: the fault left the frame alone; these do not count.
"""
