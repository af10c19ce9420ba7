"""Turn the JSON of a run of ci/bench into out/bench-field.md: report.py bench.json [--stdout]."""

import json
import os
import platform
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = ROOT / "out" / "bench-field.md"
PEERS = ROOT / "out" / "solver-peers.json"

HEAD = """\
# Speed of the field engine

Each row is one thread, 256 sources, piston directivity and
absorption. Times are processor time of that thread. Ours and the reference took turns, round for
round: *ratio* is the median of reference over ours (in brackets: the quartiles), and only ratios
compare between machines. A goal that this run missed is marked. Of rows without a goal a section
shows the first and the last; `out/bench.json` has all.
"""

SECTIONS = [
    (
        "Arbitrary points",
        "Against plain numpy in complex128 (`ci/benchmarks/references.py`).",
        "test_arbitrary_points_against_numpy",
    ),
    (
        "Arbitrary points: share of the arithmetic limit",
        "69 flop per pair of source and point, at the rate that sgemm of numpy reached beside it. "
        "The goal was set on a core with AVX-512; with AVX2 alone, the same arithmetic as one loop "
        "over the sources reaches 0.55.",
        "test_arbitrary_points_against_the_arithmetic_limit",
    ),
    (
        "Arrays of other sizes and shapes",
        "10 000 points against plain numpy in complex128; names are sources and shape: a lattice, "
        "or a bowl in which every element has a normal of its own.",
        "test_sources_against_numpy",
    ),
    (
        "Focus of one frame",
        "Warm: the phase fit from a hint 3.6 mm off, against a search of 486 points with our own "
        "kernel. Acquisition: no hint, against a search of 31 x 31 x 14 points with our own "
        "kernel and the fit from the best of them.",
        ("test_warm_fit", "test_acquisition"),
    ),
    (
        "Reconstruction of one drive",
        "What the board does with every latch: focus, uncertainty, coherence, level and force on a "
        "disc; against the same all in double precision.",
        "test_reconstruction",
    ),
    (
        "Focus and verdict of distinct drives",
        "256 drives of jittered foci: reconstruction and all criteria, at once; against the same "
        "one by one.",
        "test_distinct_drives",
    ),
    (
        "Weighted Gerchberg-Saxton, 100 rounds",
        "Against numpy in complex64; names are the number of foci.",
        "test_weighted_gerchberg_saxton",
    ),
]


def main(arguments):
    data = json.loads(Path(arguments[0]).read_text())
    text = "\n".join([HEAD, machine(data), *sections(data["benchmarks"]), *peers()])
    if "--stdout" in arguments[1:]:
        sys.stdout.write(text)
    else:
        DOCUMENT.write_text(text)
        sys.stdout.write(f"bench: wrote {DOCUMENT.name}\n{missed(data['benchmarks'])}")


def machine(data):
    info, commit = data["machine_info"], data.get("commit_info", {})
    versions = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba"))
    state = " with changes" if commit.get("dirty") else ""
    return (
        f"Machine: {info['cpu'].get('brand_raw', info['machine'])}, {os.cpu_count()} cores, "
        f"{info['system']} {info['release'].partition('-')[0]}; "
        f"Python {platform.python_version()}, {versions}.\n"
        f"Commit {str(commit.get('id'))[:10]}{state}, {data['datetime'][:10]}; "
        f"load average when written {os.getloadavg()[1]:.1f}; of the processors' time "
        f"{100 * info.get('others', 0):.0f} % went to other processes, "
        f"{100 * info.get('stolen', 0):.0f} % to other machines.\n"
    )


def version(name):
    from importlib.metadata import version

    return version(name)


def sections(benchmarks):
    for title, text, prefixes in SECTIONS:
        rows = [entry for entry in benchmarks if entry["name"].startswith(prefixes)]
        if rows:
            yield f"## {title}\n\n{text}\n\n" + "\n".join([*ratio_table(rows), ""])
    for entry in benchmarks:
        if "solvers" in entry["extra_info"]:
            yield solver_table(entry["extra_info"]["solvers"])


def peers():
    """Yield the table that ci/solver-peers measured, if it did."""
    if not PEERS.exists():
        return
    data = json.loads(PEERS.read_text())
    packages = ", ".join(f"{name} {version}" for name, version in data["packages"].items())
    yield foci_table(
        "## Solvers for several foci, next to a public package",
        f"Measured by `ci/solver-peers` with {packages}: the same foci, phase-only drives, medians "
        "over three sets. `phase_alignment` superposes single foci, `minimize` does least squares "
        "from there; both are what a user of levitate reaches for, as it has no solver of this "
        "kind by name. AcousTools has some, but needs PyTorch: it was not measured.",
        data["rows"],
    )


def ratio_table(rows):
    yield "| case | ours | rate | ratio | goal | |"
    yield "|---|---|---|---|---|---|"
    rows = sorted(rows, key=lambda entry: (entry["group"] or "", case_key(entry)))
    for at, entry in enumerate(rows):
        info = entry["extra_info"]
        if info["goal"] is None and 0 < at < len(rows) - 1:
            continue
        low, high = info["ratio_quartiles"]
        pairs = info.get("pairs")
        rate = f"{pairs / info['ours_s'] / 1e9:.3g} Gpairs/s" if pairs else ""
        goal = "" if info["goal"] is None else f"{info['goal']:g}"
        yield (
            f"| {case(entry)} | {duration(info['ours_s'])} | {rate} "
            f"| **{info['ratio']:.3g}** ({low:.3g}–{high:.3g}) | {goal} | {notes(info)} |"
        )


def notes(info):
    said = []
    if info["goal"] is not None and info["ratio"] < info["goal"]:
        said.append("missed in this run")
    if "error" in info:
        said.append(f"error {info['error']:.1e}")
    if "nodes" in info:
        said.append(f"{info['nodes']} nodes")
    if "median_error_um" in info:
        said.append(f"median error {info['median_error_um']:.1f} µm")
    if "found" in info:
        said.append(f"found {info['found']}")
    return ", ".join(said)


def missed(benchmarks):
    lines = [
        f"bench: {entry['name']}: ratio {entry['extra_info']['ratio']:.3g}, "
        f"goal {entry['extra_info']['goal']:g}\n"
        for entry in benchmarks
        if "goal" in entry["extra_info"] and "missed" in notes(entry["extra_info"])
    ]
    return "".join(lines)


def case(entry):
    return entry["param"] or entry["name"].removeprefix("test_").split("_against_")[0]


def case_key(entry):
    parts = (entry["param"] or "").split("-")
    return [float(part) for part in parts if part[:1].isdigit()]


def duration(seconds):
    for unit, scale in (("s", 1.0), ("ms", 1e3), ("µs", 1e6)):
        if seconds * scale >= 1.0 or unit == "µs":
            return f"{seconds * scale:.3g} {unit}"
    raise AssertionError


def solver_table(rows):
    return foci_table(
        "## Solvers for several foci",
        "50 rounds; medians over five sets of foci, z = 150 mm, x and y within 60 mm. Efficiency: "
        "sum of (|p_i| / sum_n |g_in|)^2. Uniformity: 1 - (max - min) / (max + min) of |p_i|^2. "
        "The time holds everything from foci to drive, checks and propagators included.",
        rows,
    )


def foci_table(title, text, rows):
    lines = [
        title,
        "",
        text,
        "",
        "| foci | " + " | ".join(dict.fromkeys(row["method"] for row in rows)) + " |",
    ]
    methods = list(dict.fromkeys(row["method"] for row in rows))
    lines.append("|---" * (1 + len(methods)) + "|")
    for foci in dict.fromkeys(row["foci"] for row in rows):
        cells = {row["method"]: row for row in rows if row["foci"] == foci}
        texts = [
            f"{cell['efficiency']:.2f} / {cell['uniformity']:.3f} / {cell['time_us'] / 1e3:.2g} ms"
            for cell in (cells[method] for method in methods)
        ]
        lines.append(f"| {foci} | " + " | ".join(texts) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main(sys.argv[1:])
