"""This tree against another commit: baseline.py [REV] [--rounds N] [pytest arguments].

Both sides are timed by the benchmarks that stand here, in turns, so that they do the same work on
the same machine at the same time; only the packages differ. A ratio is one of yardsticks: time over
that of a fixed piece of work beside it. Chance: if nothing has changed, all N
times of one side are below all N of the other in 2 of (2N over N) cases, 1 in 126 for N = 5.
"""

import contextlib
import json
import os
import shlex
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from report import duration

ROOT = Path(__file__).resolve().parents[2]
RESULT = ROOT / "out" / "bench-baseline.json"
ROUNDS = 5
FEWEST = 3  # in which chance shows a change in one row in 10
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
LEAST = 0.03  # of the time: less is of no interest, however certain


def main(arguments):
    revision, rounds, others = parse(arguments)
    baseline = git("rev-parse", "--verify", f"{revision}^{{commit}}")
    say(f"this tree against {baseline[:10]} ({git('log', '-1', '--format=%s', baseline)})")
    with working_tree(baseline) as folder:
        runs = [run_both(folder, number, rounds, others) for number in range(rounds)]
    rows = compare([now for now, _ in runs], [then for _, then in runs])
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(record(runs, baseline, rows), indent=1))
    sys.stdout.write(table(rows))
    say(f"wrote {RESULT.relative_to(ROOT)}")


def parse(arguments):
    """Return the revision, the number of rounds, and what is left for pytest."""
    left, rounds = list(arguments), ROUNDS
    if "--rounds" in left:
        at = left.index("--rounds")
        _, number, *left[at:] = left[at:] if left[at + 1 :] else (None, "")
        if not number.isdecimal() or int(number) < FEWEST:
            sys.exit(f"bench: --rounds {number!r}; it is a number from {FEWEST}")
        rounds = int(number)
    named = left and not left[0].startswith("-")
    revision = left.pop(0) if named else "HEAD" if git("status", "--porcelain") else "HEAD~1"
    return revision, rounds, left


@contextlib.contextmanager
def working_tree(commit):
    """Check *commit* out beside this tree, and remove it whatever happens, Ctrl-C and kill too."""
    before = {number: signal.signal(number, leave) for number in SIGNALS}
    parent = tempfile.mkdtemp(prefix="haptogram-bench-")
    try:
        folder = Path(parent, "baseline").resolve()
        git("worktree", "add", "--detach", "--quiet", folder, commit)
        yield folder
    finally:
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)  # until all is removed
        shutil.rmtree(parent)
        git("worktree", "prune")
        for number, handler in before.items():
            signal.signal(number, handler)


def leave(*_):
    sys.exit("bench: interrupted; the baseline is removed")


def run_both(folder, number, rounds, arguments):
    """Time both sides; every other round begins with the other one."""
    sides = [ROOT, folder] if number % 2 == 0 else [folder, ROOT]
    results = {}
    for side in sides:
        say(f"round {number + 1} of {rounds}, {'this tree' if side == ROOT else 'baseline'}")
        results[side] = run(side, arguments)
    return results[ROOT], results[folder]


def run(packages, arguments):
    """Run the benchmarks of this tree on the packages of another; return what pytest wrote."""
    benchmarks = ROOT / "ci" / "benchmarks"
    paths = [packages, packages / "protocol", benchmarks]
    with tempfile.TemporaryDirectory(prefix="haptogram-bench-") as place:
        written = Path(place, "bench.json")
        done = subprocess.run(
            [
                *(sys.executable, "-P", "-m", "pytest", benchmarks, "-c", ROOT / "pyproject.toml"),
                *("-o", f"pythonpath={shlex.join(map(str, paths))}"),
                *("-o", "filterwarnings=default", "-p", "no:cacheprovider", "--tb=short"),
                "--continue-on-collection-errors",  # the baseline may lack what a file asks for
                *("--brief", "--benchmark-disable-gc", f"--benchmark-json={written}", *arguments),
            ],
            cwd=packages,
            check=False,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        data = json.loads(written.read_text() or "{}") if written.exists() else {}
    if not data:
        sys.exit(f"{done.stdout}\nbench: nothing was measured")
    measured = Path(data["machine_info"]["packages"])
    if measured != packages:
        sys.exit(f"bench: measured the packages in {measured}, not those in {packages}")
    return data


def compare(now, then):
    """Return a row for every benchmark that ran on both sides, in every round."""
    now, then = [results(data) for data in now], [results(data) for data in then]
    names = [name for name in now[0] if all(name in one for one in now + then)]
    if others := [name for name in now[0] if name not in names]:
        say(f"{len(others)} do not run on the baseline, the first is {others[0]}")
    return [row(name, [one[name] for one in now], [one[name] for one in then]) for name in names]


def results(data):
    return {entry["name"]: entry["extra_info"] for entry in data["benchmarks"]}


def row(name, now, then):
    """Judge by yardsticks, which the load of the machine moves less than times."""
    new, old = [one["yards"] for one in now], [one["yards"] for one in then]
    ratios = [a / b for a, b in zip(new, old, strict=True)]
    ratio = statistics.median(new) / statistics.median(old)
    apart = max(new) < min(old) or max(old) < min(new)
    return {
        "name": name.removeprefix("test_"),
        "now_s": statistics.median(one["ours_s"] for one in now),
        "then_s": statistics.median(one["ours_s"] for one in then),
        "ratio": ratio,
        "lowest_ratio": min(ratios),
        "highest_ratio": max(ratios),
        "changed": apart and abs(ratio - 1) > LEAST,
    }


def table(rows):
    width = max((len(row["name"]) for row in rows), default=0)
    lines = [f"{'benchmark':{width}}  {'baseline':>9}  {'now':>9}  now/baseline (of the rounds)"]
    for row in rows:
        verdict = ("slower" if row["ratio"] > 1 else "faster") if row["changed"] else ""
        span = f"({row['lowest_ratio']:.2f} to {row['highest_ratio']:.2f})"
        lines.append(
            f"{row['name']:{width}}  {duration(row['then_s']):>9}  {duration(row['now_s']):>9}  "
            f"{row['ratio']:5.2f} {span:16} {verdict}".rstrip()
        )
    changed = [row["ratio"] for row in rows if row["changed"]]
    slower = sum(ratio > 1 for ratio in changed)
    lines.append(f"{len(rows)} compared: {slower} slower, {len(changed) - slower} faster")
    return "\n".join([*lines, ""])


def record(runs, baseline, rows):
    now = runs[0][0]
    return {
        "commit": now["commit_info"],
        "baseline": baseline,
        "machine": now["machine_info"],
        "datetime": now["datetime"],
        "rounds": len(runs),
        "rows": rows,
    }


def git(*arguments):
    done = subprocess.run(
        ["git", "-C", ROOT, *arguments],
        check=False,
        capture_output=True,
        text=True,
        env=os.environ | {"LC_ALL": "C"},
    )
    if done.returncode:
        sys.exit(f"bench: git {arguments[0]}: {done.stderr.strip()}")
    return done.stdout.strip()


def say(text):
    sys.stderr.write(f"bench: {text}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
