"""The labelled trial of a verdict without intent: drives and runs that are made for one label each.

The labels come from the bare formulas of :mod:`pattern_drives`; the classification is not asked. A
wrong name is worse than none: the trial counts what is named rightly, what is not named, and what
is named wrongly, and only the last is an error.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

import pattern_drives as drives
from haptogram.acoustics import AcousticModel, CircularPiston, Medium, Transducer
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.acoustics.reconstruct.patterns.classifier import PatternClassifier
from haptogram.verification.watch import Defect, Expectation, SeenLatch, Watch

BOARDS = {
    "sonicsurface": 32,
    "ultraino-sonicsurface": 32,
    "ultraino-flat8": 10,
    "interactlab": 128,
    "autd3": 256,
    "sonicsurface-stack": 32,
    "tinylev": 10,
}
FLAT = ("sonicsurface", "ultraino-sonicsurface", "ultraino-flat8", "interactlab", "autd3")
KINDS = ("one focus", "twin trap", "vortex", "several foci", "none of these", "uniform", "off")
LATCHES = 5
NONE = "none of these"


@dataclass
class Tally:
    """Right, not named and wrong by label."""

    counts: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    wrong: list[str] = field(default_factory=list)

    def add(self, label: str, outcome: str, what: str) -> None:
        self.counts[label][outcome] += 1
        if outcome == "wrong":
            self.wrong.append(f"{label}: {what}")

    def table(self) -> str:
        rows = ["| label | cases | right | not named | wrong |", "|---|---|---|---|---|"]
        for label, found in self.counts.items():
            cells = [sum(found.values()), *(found[n] for n in ("right", "not named", "wrong"))]
            rows.append(f"| {label} | " + " | ".join(map(str, cells)) + " |")
        return "\n".join(rows)


# --- one drive ------------------------------------------------------------------------------------


def pattern_case(rng, board: str, kind: str):
    """A drive of that kind, in air that may differ by 1 %, near or far, on a plane or off it."""
    positions, steps = LAYOUTS[board].array().positions_m, BOARDS[board]
    k = drives.k_of(drives.SPEED_M_S * (1.0 + rng.uniform(-0.01, 0.01)))
    if kind == "off":
        return np.zeros(len(positions)), drives.Wanted(kind, np.zeros((0, 3)))
    if kind == "uniform":
        return np.full(len(positions), np.exp(1j * rng.uniform(0, 6))), drives.Wanted(
            kind, np.zeros((0, 3))
        )
    phases, wanted = drives.random_pattern(rng, positions, kind, k)
    codes = drives.coded(phases, steps, cut_off=bool(rng.integers(2)))
    weights = drives.radiated(codes, steps)
    if rng.random() < 0.25:  # a few elements are silent or not a number
        lost = rng.choice(len(positions), max(1, len(positions) // 40), replace=False)
        weights[lost] = rng.choice([0.0, np.nan])
    return weights, wanted


def pattern_outcome(found, wanted, board: str) -> str:
    kind = found.kind
    if wanted.kind == "uniform" and board == "tinylev":
        return "right" if kind == "one focus" else "wrong"  # its bowls focus on their middle
    if kind == wanted.kind:
        if kind == "vortex" and found.charge != wanted.charge:
            return "wrong"
        if kind == "several foci" and len(found.positions_m) != len(wanted.places_m):
            return "wrong"
        return "right"
    return "not named" if kind == NONE else "wrong"


class Patterns:
    """Classifiers, one for each board."""

    def __init__(self) -> None:
        self._kept: dict[str, PatternClassifier] = {}

    def classify(self, board: str, weights):
        if board not in self._kept:
            self._kept[board] = PatternClassifier(model_of(board), BOARDS[board])
        self._kept[board].reset()
        return self._kept[board].classify(weights)


def model_of(board: str) -> AcousticModel:
    array = LAYOUTS[board].array()
    return AcousticModel(array, Medium(drives.SPEED_M_S, 1.2), Transducer(CircularPiston(4.5e-3)))


# --- runs of a client -----------------------------------------------------------------------------


def unspoilt(weights: np.ndarray) -> np.ndarray:
    return weights


@dataclass
class Client:
    """What a client means and does: where it aims, and what becomes of its frames."""

    rng: np.random.Generator
    board: str
    targets: np.ndarray
    aims: np.ndarray
    speed: float = drives.SPEED_M_S
    spoil: Callable[[np.ndarray], np.ndarray] = unspoilt
    counted: dict[str, int] = field(default_factory=dict)
    stray: tuple[int, ...] = ()
    labels: frozenset[Defect] = frozenset()
    text: str = ""

    def latches(self) -> Iterator[SeenLatch]:
        positions, steps = LAYOUTS[self.board].array().positions_m, BOARDS[self.board]
        for number, aim in enumerate(self.aims, start=1):
            phases = drives.focus(positions, aim, drives.k_of(self.speed))
            codes = drives.coded(phases + self.rng.uniform(0, 6), steps)
            weights = self.spoil(drives.radiated(codes, steps))
            strange = self.counted if number == 2 else {}
            yield SeenLatch(number, weights, steps, counted=strange, stray=self.stray)


def client_of(rng, board: str) -> Client:
    """A client without a defect, with targets off the planes or, now and then, on one."""
    array = LAYOUTS[board].array()
    half = np.ptp(array.positions_m, axis=0).max() / 2.0
    local = rng.uniform([-0.6, -0.6, 0.8], [0.6, 0.6, 2.4], (LATCHES, 3))
    if board in OTHER_BOARDS:
        local = rng.uniform(-0.5, 0.5, (LATCHES, 3))
    if rng.random() < 0.15:
        local[:, int(rng.integers(2))] = 0.0
    targets = array.centre_m + local * half
    return Client(rng, board, targets, targets.copy())


def turned(client: Client, matrix) -> None:
    centre = LAYOUTS[client.board].array().centre_m
    client.aims = centre + (client.targets - centre) @ np.array(matrix, dtype=float).T


def mirrored(client: Client) -> None:
    axis = int(client.rng.integers(2))
    turned(client, np.diag([-1.0, 1, 1] if axis == 0 else [1.0, -1, 1]))
    client.labels, client.text = frozenset({Defect.ORDER}), f"{'xy'[axis]} mirrored"


def transposed(client: Client) -> None:
    turned(client, [[0, 1, 0], [1, 0, 0], [0, 0, 1]])
    client.labels, client.text = frozenset({Defect.ORDER}), "transposed"


def other_frame(client: Client) -> None:
    way = client.rng.normal(size=3)
    client.aims = client.targets + way / np.linalg.norm(way) * client.rng.uniform(1e-3, 6e-3)
    client.labels = frozenset({Defect.AXES})


def frame_of_ultraino(client: Client) -> None:
    client.aims = client.targets + np.array([0.0, 2e-3, 0.0])
    client.labels = frozenset({Defect.AXES})


def other_speed(client: Client) -> None:
    client.speed = client.rng.choice([331.0, 336.0, 340.0, 346.0, 350.0])
    client.labels = frozenset({Defect.SPEED})


def mirrored_in_other_air(client: Client) -> None:
    mirrored(client)
    client.speed = 346.0
    client.labels |= {Defect.SPEED}


def other_frame_in_other_air(client: Client) -> None:
    frame_of_ultraino(client)
    client.speed = 346.0
    client.labels |= {Defect.SPEED}


def inverted(client: Client) -> None:
    client.spoil = np.conj
    client.labels = frozenset({Defect.SIGN})


def inverted_in_other_air(client: Client) -> None:
    inverted(client)
    client.speed = client.rng.choice([340.0, 346.0])
    client.labels |= {Defect.SPEED}


def inverted_and_mirrored(client: Client) -> None:
    mirrored(client)
    inverted(client)
    client.labels |= {Defect.ORDER}


def reversed_elements(client: Client) -> None:
    count = LAYOUTS[client.board].array().count
    sign = np.ones(count)
    sign[client.rng.choice(count, int(client.rng.integers(1, 4)), replace=False)] = -1.0
    client.spoil = lambda weights: weights * sign
    client.labels = frozenset({Defect.REVERSED})


def silent_elements(client: Client) -> None:
    count = LAYOUTS[client.board].array().count
    dead = client.rng.choice(count, int(client.rng.integers(1, count // 8)), replace=False)
    client.spoil = lambda weights: np.where(np.isin(np.arange(count), dead), np.nan, weights)
    client.labels = frozenset({Defect.SILENT})


def stray_channels(client: Client) -> None:
    client.stray = tuple(range(1000, 1000 + int(client.rng.integers(1, 184))))
    client.labels = frozenset({Defect.STRAY_CHANNELS})


def lost_bytes(client: Client) -> None:
    kind = client.rng.choice(["frames_short", "frames_cut_short", "start_bits_in_frame"])
    count = LAYOUTS[client.board].array().count
    at = int(client.rng.integers(5, count - 5))
    whole = client.spoil
    number = iter(range(1, LATCHES + 1))

    def spoil(weights):
        weights = whole(weights)
        if next(number) == 2:  # all that follows the lost byte is a channel too early
            weights = np.concatenate([weights[:at], weights[at + 1 :], weights[-1:]])
        return weights

    client.spoil, client.counted = spoil, {str(kind): 1}
    client.labels = frozenset({Defect.BYTES_LOST})


def lost_commit(client: Client) -> None:
    client.counted = {"frames_without_commit": 1}
    client.labels = frozenset({Defect.NO_COMMIT})


def turned_a_little(client: Client) -> None:
    """A defect that has no name here."""
    turn = np.radians(client.rng.uniform(2.0, 12.0))
    cosine, sine = np.cos(turn), np.sin(turn)
    turned(client, [[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])


def scaled_targets(client: Client) -> None:
    """A defect that has no name here."""
    turned(client, np.eye(3) * client.rng.choice([0.9, 0.95, 1.05, 1.1]))


def scattered_targets(client: Client) -> None:
    """A defect that has no name here."""
    client.aims = client.targets + client.rng.normal(0.0, 3e-3, client.targets.shape)


def part_of_the_array(client: Client) -> None:
    """No defect: some leave a rim or a side of the array out."""
    array = LAYOUTS[client.board].array()
    local = array.positions_m - array.centre_m
    limit = client.rng.uniform(0.6, 0.95)
    if client.rng.random() < 0.5:
        left_out = np.linalg.norm(local, axis=1) > limit * np.linalg.norm(local, axis=1).max()
    else:
        left_out = local[:, 0] > limit * local[:, 0].max()
    client.spoil = lambda weights: np.where(left_out, 0.0, weights)


def nothing_wrong(client: Client) -> None:
    """No defect."""


DEFECTS = (
    nothing_wrong,
    mirrored,
    transposed,
    other_frame,
    frame_of_ultraino,
    other_speed,
    mirrored_in_other_air,
    other_frame_in_other_air,
    inverted,
    inverted_in_other_air,
    inverted_and_mirrored,
    reversed_elements,
    silent_elements,
    stray_channels,
    lost_bytes,
    lost_commit,
    turned_a_little,
    scaled_targets,
    scattered_targets,
    part_of_the_array,
)
WITH_EXPECTATION = {Defect.SIGN, Defect.ORDER, Defect.AXES, Defect.SPEED}
# Boards face to face, and bowls, have other symmetries than flat ones.
OTHER_BOARDS = ("sonicsurface-stack", "tinylev")
THERE_TOO = (nothing_wrong, inverted, inverted_in_other_air, scattered_targets)


def run_outcome(client: Client, *, expected: bool) -> tuple[str, str]:
    """Right, not named or wrong, and what was named."""
    model = model_of(client.board)
    expectation = Expectation(model, list(client.targets)) if expected else None
    watch = Watch(model, expectation=expectation)
    for latch in client.latches():
        watch.take(latch)
    found = watch.result().diagnoses
    labels = client.labels if expected else client.labels - WITH_EXPECTATION
    what = f"{client.board}, {'expected' if expected else 'not expected'}: {[*map(str, found)]}"
    for diagnosis in found:
        told = {diagnosis.defect} | {d for d in Defect if f"; and {d}:" in diagnosis.detail}
        if told == {Defect.ELEMENTS} and Defect.REVERSED in labels:
            continue  # few coarse drives show which, and prove no polarity
        if not told <= labels or not _figures_right(client, diagnosis.detail, told):
            return "wrong", what
    if labels and not found:
        return "not named", what
    return "right", what


def _figures_right(client: Client, detail: str, told: set[Defect]) -> bool:
    if Defect.ORDER in told and client.text not in detail:
        return False
    speed = re.search(r"assumes ([0-9.]+) m/s", detail)
    return speed is None or abs(float(speed[1]) - client.speed) < 2.0


# --- the trial ------------------------------------------------------------------------------------


def trial(cases: int, seed: int, tell: Callable[[str], object] = lambda _: None) -> Tally:
    """Draw *cases* drives and runs in turn, of every board, pattern and defect alike."""
    tally, patterns = Tally(), Patterns()
    combinations = [("pattern", board, kind) for kind in KINDS for board in BOARDS]
    combinations += [("run", board, defect) for defect in DEFECTS for board in FLAT]
    combinations += [("run", board, defect) for defect in THERE_TOO for board in OTHER_BOARDS]
    order = np.random.default_rng(seed).permutation(len(combinations))
    for number in range(cases):
        rng = np.random.default_rng([seed, number])
        form, board, what = combinations[order[number % len(combinations)]]
        if form == "pattern":
            weights, wanted = pattern_case(rng, board, what)
            found = patterns.classify(board, weights)
            outcome = pattern_outcome(found, wanted, board)
            tally.add(what, outcome, f"case {number}, {board}: {found.kind}")
        else:
            client = client_of(rng, board)
            what(client)
            expected = bool(rng.random() < 0.7)
            outcome, told = run_outcome(client, expected=expected)
            tally.add(what.__name__.replace("_", " "), outcome, f"case {number}, {told}")
        if tally.wrong:
            tell(tally.wrong[-1])
    return tally


def main() -> int:
    """Print the table; status 1 for a wrong name."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    tally = trial(options.cases, options.seed)
    sys.stdout.write(f"{tally.table()}\n")
    for text in tally.wrong:
        sys.stdout.write(f"wrong: {text}\n")
    return 1 if tally.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
