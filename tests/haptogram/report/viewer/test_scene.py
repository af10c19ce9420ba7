"""Scenes: what is packed comes back, and a page stays small."""

from __future__ import annotations

import base64
import json
import struct
import zlib
from typing import Any

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, Drive
from haptogram.records.frame import Evidence, Observation
from haptogram.report.run.document import run_viewer_scene
from haptogram.report.viewer.frames import EARLY, LATE, STATUSES, TIMELY, ViewerFrame
from haptogram.report.viewer.scene import ViewerScene
from haptogram.verification import FrameStatus
from judged_runs import make_run, targets

_KINDS = {"u1": "<u1", "u4": "<u4", "f4": "<f4", "f8": "<f8"}


def unpack(packed: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
    """An unpacker of its own, written from the docstring of the format."""
    assert packed[:4] == b"HGV1"
    (length,) = struct.unpack_from("<I", packed, 4)
    header = json.loads(packed[8 : 8 + length])
    offset, columns = 8 + length, {}
    for name, kind, shape in header["columns"]:
        offset += -offset % 8
        count = int(np.prod(shape))
        columns[name] = np.frombuffer(packed, _KINDS[kind], count, offset).reshape(shape)
        offset += columns[name].nbytes
    assert len(packed) == offset + -offset % 8
    return header, columns


def random_drive(count: int, seed: int, bits: int = 8) -> Drive:
    rng = np.random.default_rng(seed)
    codes = rng.integers(0, 1 << bits, count, dtype=np.uint8)
    return Drive(codes, rng.integers(0, 256, count, dtype=np.uint8), bits)


@pytest.mark.parametrize("bits", range(1, 9))
def test_a_scene_comes_back_as_it_was_packed(bits: int) -> None:
    model = AcousticModel.default(3, 5)
    drives = [random_drive(15, seed, bits) for seed in range(3)]
    frames = [
        ViewerFrame(
            number=7,
            timing=LATE,
            due_us=2**40,
            received_us=2**40 - 90_500,
            latched_us=2**40 + 25,
            target_m=(0.01, -0.02, 0.15),
            found_m=(0.011, None, 0.15),
            pressure_pa=123.5,
            force_n=0.002,
            drive=drives[0],
        ),
        ViewerFrame(number=8, status=str(FrameStatus.LOST)),
        ViewerFrame(number=9, timing=EARLY, drive=drives[1], received_us=70, latched_us=50),
        ViewerFrame(number=10, timing=TIMELY, drive=drives[2]),
    ]
    header, columns = unpack(ViewerScene.of(model, frames, counters={"lost": 1}).pack())
    assert header["counters"] == {"lost": 1}
    assert header["statuses"] == list(STATUSES)
    assert columns["number"].tolist() == [7, 8, 9, 10]
    assert [STATUSES[code] for code in columns["status"]] == [
        "latched",
        "lost",
        "latched",
        "latched",
    ]
    assert columns["timing"].tolist() == [LATE, TIMELY, EARLY, TIMELY]
    assert columns["due_us"][0] == 2**40
    assert columns["latched_us"][0] == 2**40 + 25
    assert np.isnan(columns["due_us"][1])
    np.testing.assert_allclose(columns["margin_ms"], (90.5, np.nan, -0.02, np.nan), rtol=1e-6)
    np.testing.assert_allclose(columns["target_mm"][0], (10, -20, 150), rtol=1e-6)
    np.testing.assert_allclose(columns["found_mm"][0], (11, np.nan, 150), rtol=1e-6)
    np.testing.assert_allclose(columns["force_mn"][0], 2.0, rtol=1e-6)
    assert columns["seen"].tolist() == [1, 0, 1, 1]
    for row, drive in ((0, drives[0]), (2, drives[1]), (3, drives[2])):
        turns = columns["phases"][row] / header["phase_steps"]
        np.testing.assert_array_equal(turns, drive.phase_codes / (1 << bits))
        np.testing.assert_array_equal(columns["amplitudes"][row], drive.amplitude_codes)


def test_equal_amplitudes_are_said_once() -> None:
    model = AcousticModel.default(2, 2)
    full = np.full(4, 255, dtype=np.uint8)
    frames = [ViewerFrame(number=n, drive=Drive(full * 0 + n, full)) for n in range(5)]
    _, columns = unpack(ViewerScene.of(model, [*frames, ViewerFrame(number=5)]).pack())
    assert columns["amplitudes"].tolist() == [full.tolist()]


def test_texts_are_those_of_the_first_500_frames_that_want_attention() -> None:
    frames = [
        ViewerFrame(number=0, status=str(FrameStatus.ON_TARGET), text="on target"),
        ViewerFrame(number=1, status=str(FrameStatus.ON_TARGET), timing=LATE, text="late"),
        ViewerFrame(number=2, timing=EARLY, text="early"),
        ViewerFrame(number=3, text="latched"),
        ViewerFrame(number=4, status=str(FrameStatus.LOST)),
        *(ViewerFrame(number=n, status=str(FrameStatus.LOST), text="lost") for n in range(5, 700)),
    ]
    header, _ = unpack(ViewerScene.of(AcousticModel.default(2, 2), frames).pack())
    assert list(header["texts"]) == [str(number) for number in (1, 2, *range(5, 503))]
    assert header["texts"]["1"] == "late"


@pytest.mark.nightly
def test_a_hemisphere_is_small() -> None:
    model = AcousticModel.default()
    run = make_run(model, targets(672), min_verified=1.0)
    full = np.full(256, 255, np.uint8)
    seen = {
        f.number: Observation(
            f.key,
            1000 * f.number,
            False,
            Evidence.EXTERNAL,
            Drive(random_drive(256, f.number).phase_codes, full),
            t_received_us=1000 * f.number - 90_000,
        )
        for f in run.frames
    }
    embedded = run_viewer_scene(run, model, seen).embedded()
    assert len(embedded) < 350_000  # noise of phases cannot be compressed: 230 kB are theirs
    assert unpack(zlib.decompress(base64.b64decode(embedded)))[1]["phases"].shape == (672, 256)
