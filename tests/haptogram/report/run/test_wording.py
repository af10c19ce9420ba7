from __future__ import annotations

import dataclasses

from haptogram.records.frame import FrameKey
from haptogram.report.run.wording import (
    run_count_wording,
    run_figure_wording,
    run_frame_wording,
)
from haptogram.verification import Consequence, FrameStatus, FrameVerdict, verdict_consequence_text

LOST = FrameVerdict(3, FrameKey(1, 0, 0, 65539), FrameStatus.LOST, None, (0.0, 0.0, 0.1))


def test_a_frame_of_a_sequence_is_named_by_its_place_in_it() -> None:
    frame = dataclasses.replace(LOST, key=FrameKey(1, 7, 2, 5))
    assert (
        run_frame_wording(frame)
        == "frame 3: lost (sequence 7, loop 2, index 5, as soon as complete)"
    )


def test_a_frame_is_described_with_all_that_is_known_of_it() -> None:
    frame = dataclasses.replace(
        LOST,
        status=FrameStatus.WRONG_DRIVE,
        t_apply_us=1000,
        t_latch_us=1400,
        late=True,
        latches=2,
        faults=("element 5 dead",),
        criteria={"S1": True, "S3": False, "S5": False},
        lateral_error_mm=0.5,
        axial_error_mm=-1.25,
        consequence=Consequence(4.0, 100.0, 2000.0),
        note="odd",
    )
    assert run_frame_wording(frame) == (
        "frame 3: wrong drive; 400 µs late; latched 2 times; element 5 dead; "
        "0.500 mm across, -1.250 mm along; the focus stayed 4.0 mm away: 100 Pa instead of "
        "2000 Pa; a miss that cannot be observed does not show; S1, S3 failed, S5 failed "
        "(stream index 65539, due at 1000 µs)"
    )


def test_what_is_not_known_is_a_dash() -> None:
    assert run_figure_wording(None) == "–"
    assert run_figure_wording(1.5, 1) == "1.5"


def test_silence_has_no_place() -> None:
    assert verdict_consequence_text(Consequence(None, 0.0, 2000.0)) == "silence instead of 2000 Pa"


def test_one_is_not_many() -> None:
    assert [run_count_wording(number, "frame") for number in (0, 1, 2)] == [
        "0 frames",
        "1 frame",
        "2 frames",
    ]
