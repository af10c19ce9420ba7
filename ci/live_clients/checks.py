"""Each client against the board of its dialect: what it meant beside what was radiated."""

from __future__ import annotations

import base64
import dataclasses
import json
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from .board import Latch, VirtualBoard, powered_up
from .environments import Environment
from .results import Result

__all__ = ["CHECKS"]

HERE: Final = Path(__file__).parent
SECONDS_TO_2000: Final = 946_684_800
TARGET_MM: Final = np.array([96.6, 76.7, 150.0])  # as in pyautd3_program
AUTD3_WAVE_NUMBER: Final = 2 * np.pi * 40_000 / 340.0
OF_TWO_DEVICES: Final = {"focus", "foci", "circle"}
LATCH_US: Final = 2000  # far from what a loaded machine keeps up with
LONGER: Final = "12"  # times that the emulator goes on, to see all that a live run may show
LEAST_COHERENCE: Final = 0.99
# Cases whose drives change too fast for a latch each
FLEETING: Final = {"foci", "circle", "modulation", "segments", "modulation_segments"}
# Those of refusals, and those that autd3's emulator shows by other laps than the HDL
WITHOUT_DRIVES: Final = {"refusals", "turns"}


def check_pyautd3(environment: Environment, folder: Path) -> Iterator[Result]:
    """Run pyautd3 against one device and two, and compare with autd3's own emulator."""
    yield from _check_devices(environment, folder, 1, None)
    yield from _check_devices(environment, folder, 2, OF_TWO_DEVICES)


def _check_devices(
    environment: Environment, folder: Path, devices: int, names: set[str] | None
) -> Iterator[Result]:
    program = HERE / "pyautd3_program.py"
    emulated = json.loads(environment.run(program, "emulate", LONGER, str(devices)))
    now_ns = (int(time.time()) - SECONDS_TO_2000) * 10**9
    options = ["--tcp", "127.0.0.1:0"]
    for option in (f"devices={devices}", f"system_ns={now_ns}", f"latch_us={LATCH_US}"):
        options += ["--dialect-option", option]
    with powered_up(folder, "autd3", *options) as board:
        for name, case in emulated.items():
            if names is not None and name not in names:
                continue
            before = len(board.latches())
            try:
                told = json.loads(
                    environment.run(program, "live", board.address, name, str(devices))
                )
            except subprocess.SubprocessError as error:
                yield Result(environment, "autd3", name, "fail", note=_told(error))
                continue
            latches = board.latches()[before:]
            result = _autd3_result(environment, name, case, told, latches, board)
            if devices > 1:
                result = dataclasses.replace(result, case=f"{name}, {devices} devices")
            yield result


def _autd3_result(
    environment: Environment,
    name: str,
    case: dict[str, Any],
    told: dict[str, Any],
    latches: list[Latch],
    board: VirtualBoard,
) -> Result:
    expected = {} if name in WITHOUT_DRIVES else dict(_drives(case))
    shown = [latch for latch in latches if latch.cause != "clear"] if expected else []
    codes = sum(latch.rises.size for latch in shown)
    right = sum(latch.rises.size if latch.key() in expected else 0 for latch in shown)
    seen = {latch.key() for latch in shown} & expected.keys()
    note, coherence = "", None
    if told["refusals"] != case["refusals"]:
        note = f"refusals differ: {told['refusals']}"
    elif expected and (not shown or right < codes):
        note = "drives that autd3's emulator does not have"
    elif expected and name not in FLEETING and len(seen) < len(expected):
        note = f"{len(seen)} of {len(expected)} drives were shown"
    if name == "focus" and shown:
        target_m = TARGET_MM * 1e-3
        gain = next(latch for latch in shown if latch.cause == "gain")  # the end sends another
        coherence = gain.coherence(board.positions_m(), target_m, AUTD3_WAVE_NUMBER)
        if coherence < LEAST_COHERENCE:
            note = note or "the focus is not at the target"
    verdict = "fail" if note else "pass"
    if not note and expected:
        note = f"{len(seen)} drives"
    elif not note:
        note = f"{len(case['refusals'])} errors, as the emulator words them; drives not compared"
    return Result(environment, "autd3", name, verdict, right, codes, coherence, note)


def _drives(case: dict[str, Any]) -> Iterator[tuple[bytes, int]]:
    """Yield the keys of the drives that the emulator had, but for the one that is off."""
    phases = np.zeros(0, np.int64)
    for change in case["changes"]:
        if "phases" in change:
            phases = np.frombuffer(base64.b64decode(change["phases"]), np.uint8).astype(np.int64)
        widths = np.broadcast_to(np.array(change["widths"], np.int64), phases.shape)
        rises = np.where(widths > 0, (2 * phases - widths // 2) % 512, 0)
        yield rises.astype("<u2").tobytes() + widths.astype("<u2").tobytes(), change["period"]


def check_levitate(environment: Environment, folder: Path) -> Iterator[Result]:
    """Let levitate drive a board of InteractLab, and compare with its own arithmetic."""
    link = folder / "interactlab"
    with powered_up(folder, "interactlab", "--link", str(link)) as board:
        try:
            told = json.loads(environment.run(HERE / "levitate_program.py", str(link)))
        except subprocess.SubprocessError as error:
            yield Result(environment, "interactlab", "frames", "fail", note=_told(error))
            return
        shown = board.latches(1 + len(told["frames"]))  # that of the power-up comes first
        frames = [latch for latch in shown if latch.cause == "frame"]
        if len(frames) != len(told["frames"]):
            note = f"{len(told['frames'])} frames were sent, {len(frames)} were shown"
            yield Result(environment, "interactlab", "frames", "fail", note=note)
            return
        for meant, latch in zip(told["frames"], frames, strict=True):
            yield _levitate_result(environment, meant, latch, told["k"], board)


def _levitate_result(
    environment: Environment,
    meant: dict[str, Any],
    latch: Latch,
    wave_number: float,
    board: VirtualBoard,
) -> Result:
    wrong = (latch.rises != meant["phases"]) | (latch.widths != meant["duties"])
    right, codes = int((~wrong).sum()), wrong.size
    note, coherence = "", None
    if "target_m" in meant:
        target_m = np.array(meant["target_m"])
        coherence = latch.coherence(board.positions_m(), target_m, wave_number)
        if coherence < LEAST_COHERENCE:
            note = "the focus is not at the target"
    if right < codes:
        note = f"{codes - right} codes are not those of levitate"
    verdict = "fail" if note else "pass"
    if not note and meant["clipped"]:
        note = f"{meant['clipped']} phases were clipped at 127 instead of wrapped"
    name = meant["name"]
    if "target_m" in meant:
        name += " at ({:g}, {:g}, {:g}) mm".format(*(1e3 * x for x in meant["target_m"]))
    return Result(environment, "interactlab", name, verdict, right, codes, coherence, note)


def _told(error: subprocess.SubprocessError) -> str:
    """Return the last line that a client said."""
    if isinstance(error, subprocess.CalledProcessError) and (error.stderr or "").strip():
        return f"the client says: {error.stderr.strip().splitlines()[-1]}"
    return str(error)


CHECKS: Final[dict[str, Callable[[Environment, Path], Iterator[Result]]]] = {
    "pyautd3": check_pyautd3,
    "levitate": check_levitate,
}
