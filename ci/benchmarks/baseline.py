"""This tree against another commit: ``ci/bench --baseline [REV]``.

Each tree runs its own benchmarks on its own packages, in turns on the same machine, and rows of the
same name are compared. A ratio is one of yardsticks: time over that of a fixed piece of work beside
it. Chance: if nothing has changed, all N times of one side are below all N of the other in 2 of
(2N over N) cases, 1 in 126 for N = 5.
"""

import argparse
import json
import statistics
import sys

from report import duration
from rows import repeated, row_of_result
from trees import ROOT, baseline_tree, git, say, stop, this_tree

RESULT = ROOT / "out" / "bench-baseline.json"
ROUNDS = 5
FEWEST = 3  # in which chance shows a change in one row in 10
THRESHOLD_PERCENT = 3.0  # less is of no interest, however certain
SLOWER = 1  # exit status
ONE_SIDED = ("only here", "only in the baseline")


def main(arguments):
    options, others = parse(arguments)
    revision = options.revision or ("HEAD" if git("status", "--porcelain") else "HEAD~1")
    commit = git("rev-parse", "--verify", f"{revision}^{{commit}}")
    say(f"this tree against {commit[:10]} ({git('log', '-1', '--format=%s', commit)})")
    with baseline_tree(commit) as baseline:
        measurement = Measurement(baseline, options.rounds, options.threshold / 100)
        rows = measurement.rows(others)
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(record(measurement, commit, rows), indent=1))
    sys.stdout.write(table(rows))
    say(f"wrote {RESULT.relative_to(ROOT)}")
    return SLOWER if any(row["verdict"] == "slower" for row in rows) else 0


def parse(arguments):
    """Return the options, and what is left for pytest."""
    parser = argparse.ArgumentParser(prog="ci/bench --baseline [REV]", allow_abbrev=False)
    parser.add_argument("--rounds", type=int, default=ROUNDS, metavar="N")
    parser.add_argument("--threshold", type=float, default=THRESHOLD_PERCENT, metavar="PERCENT")
    named = bool(arguments) and not arguments[0].startswith("-")
    options, others = parser.parse_known_args(arguments[named:])
    options.revision = arguments[0] if named else None
    if options.rounds < FEWEST:
        parser.error(f"--rounds is {options.rounds}, must be {FEWEST} or more")
    if not options.threshold >= 0:
        parser.error(f"--threshold is {options.threshold:g} %, must be 0 or more")
    return options, others


class Measurement:
    """The rounds of both trees, and the rows that they share."""

    def __init__(self, baseline, rounds, threshold):
        self.now, self.then = this_tree(), baseline
        self.rounds, self.threshold = rounds, threshold
        self.first = {}

    def rows(self, arguments):
        """Measure; measure a row again that came out slower, which counts in its place."""
        runs = self._runs(lambda tree: tree.run(arguments))
        rows = compare(*runs, self.threshold)
        if not rows:
            stop("bench: neither tree has a benchmark of that name: -k selects by names of tests")
        slower = [row["name"] for row in rows if row["verdict"] == "slower"]
        if not slower:
            return rows
        say(f"{len(slower)} came out slower and are measured again, which counts")
        selected = {self.now: tests(runs[0][0], slower), self.then: tests(runs[1][0], slower)}
        again = self._runs(lambda tree: tree.run(arguments, selected[tree]))
        counts = {row["name"]: row for row in compare(*again, self.threshold)}
        return [counts.get(row["name"], row) for row in rows]

    def _runs(self, measure):
        """Return the runs of both sides; every other round begins with the other side."""
        found = {self.now: [], self.then: []}
        sides = [self.now, self.then]
        for number in range(self.rounds):
            for tree in sides:
                say(f"round {number + 1} of {self.rounds}, {tree.name}")
                found[tree].append(measure(tree))
            sides.reverse()
        self.first = self.first or found[self.now][0]
        return found[self.now], found[self.then]


def results(data):
    """Return the measurement of every row of one run."""
    named = [(row_of_result(entry), entry["extra_info"]) for entry in data["benchmarks"]]
    named = [(name, info) for name, info in named if name is not None]
    if twice := repeated([name for name, _ in named]):
        stop(f"bench: two benchmarks measure {twice[0]!r}: give one another row")
    return dict(named)


def tests(data, names):
    """Return the tests of these rows, as pytest names them."""
    return [entry["fullname"] for entry in data["benchmarks"] if row_of_result(entry) in names]


def compare(now, then, threshold):
    """Return a row for every name, in the order of the newer side."""
    now, then = [results(data) for data in now], [results(data) for data in then]
    names = list(dict.fromkeys([*now[0], *then[0]]))
    return [
        row(name, *([one[name] for one in side if name in one] for side in (now, then)), threshold)
        for name in names
    ]


def row(name, now, then, threshold):
    """Judge by yardsticks, which the load of the machine moves less than times."""
    found = {"name": name, "now_s": time_of(now), "then_s": time_of(then)}
    if not now or not then:
        return found | {"verdict": ONE_SIDED[not now]}
    new, old = [one["yards"] for one in now], [one["yards"] for one in then]
    ratios = [a / b for a, b in zip(new, old, strict=True)]
    ratio = statistics.median(new) / statistics.median(old)
    found |= {"ratio": ratio, "lowest_ratio": min(ratios), "highest_ratio": max(ratios)}
    apart = max(new) < min(old) or max(old) < min(new)
    if not apart or abs(ratio - 1) <= threshold:
        return found | {"verdict": ""}
    return found | {"verdict": "slower" if ratio > 1 else "faster"}


def time_of(runs):
    return statistics.median(one["ours_s"] for one in runs) if runs else None


def table(rows):
    width = max((len(row["name"]) for row in rows), default=0)
    lines = [f"{'row':{width}}  {'baseline':>9}  {'now':>9}  now/baseline (of the rounds)"]
    for row in rows:
        times = "  ".join(f"{shown(row[side]):>9}" for side in ("then_s", "now_s"))
        ratio = ""
        if "ratio" in row:
            span = f"({row['lowest_ratio']:.2f} to {row['highest_ratio']:.2f})"
            ratio = f"{row['ratio']:5.2f} {span}"
        lines.append(f"{row['name']:{width}}  {times}  {ratio:22} {row['verdict']}".rstrip())
    verdicts = [row["verdict"] for row in rows]
    both = sum("ratio" in row for row in rows)
    words = ["slower", "faster", *(word for word in ONE_SIDED if word in verdicts)]
    counts = ", ".join(f"{verdicts.count(word)} {word}" for word in words)
    return "\n".join([*lines, f"{both} compared: {counts}", ""])


def shown(seconds):
    return "-" if seconds is None else duration(seconds)


def record(measurement, commit, rows):
    now = measurement.first
    return {
        "commit": now.get("commit_info"),
        "baseline": commit,
        "machine": now.get("machine_info"),
        "datetime": now.get("datetime"),
        "rounds": measurement.rounds,
        "threshold": measurement.threshold,
        "rows": rows,
    }


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
