"""What lost, late and wrong frames do in space: times, distances and pressures, against by hand."""

from __future__ import annotations

import dataclasses

import pytest

from haptogram.records.frame import FrameKey
from haptogram.verification import Consequence, FrameStatus, FrameVerdict, RunConsequences

HELD = Consequence(5.0, 1000.0, 4000.0)
SILENCE = Consequence(None, 0.0, 4000.0)


def frame(number: int, **changes: object) -> FrameVerdict:
    """A frame that was latched at its time, 1 ms after the one before it."""
    at_us = 1000 * number
    right = FrameVerdict(
        number,
        FrameKey.of_stream(1, number),
        FrameStatus.ON_TARGET,
        None,
        (0.0, 0.0, 0.1),
        lateral_error_mm=0.01,
        axial_error_mm=0.02,
        coherence=1.0,
        intended_pressure_rms_pa=4000.0,
        t_apply_us=at_us,
        t_latch_us=at_us,
        latches=1,
    )
    return dataclasses.replace(right, **changes)  # type: ignore[arg-type]  what the test says


def lost(number: int, consequence: Consequence | None = HELD) -> FrameVerdict:
    return frame(number, status=FrameStatus.LOST, t_latch_us=None, consequence=consequence)


def effect_of(*frames: FrameVerdict, silences: tuple[int, ...] = ()) -> RunConsequences:
    found = RunConsequences.of(frames, silences)
    assert found is not None
    return found


def test_a_run_that_is_right_has_none() -> None:
    assert RunConsequences.of([]) is None
    assert RunConsequences.of([frame(0), frame(1)]) is None


def test_lost_frames_count_until_the_next_latch() -> None:
    found = effect_of(frame(0), lost(1), lost(2), frame(3), lost(4))
    assert (found.away_ms, found.longest_ms, found.silent_ms) == (3.0, 2.0, 0.0)
    assert (found.farthest_mm, found.radiated_pa, found.intended_pa) == (5.0, 1000.0, 4000.0)


def test_before_the_first_latch_there_is_silence() -> None:
    found = effect_of(lost(0, SILENCE), frame(1))
    assert (found.away_ms, found.silent_ms, found.farthest_mm) == (1.0, 1.0, None)
    assert str(found) == (
        "not as intended for 1.0 ms, 1.0 ms at a time, silent for 1.0 ms, "
        "0 Pa instead of 4000 Pa at the targets meanwhile"
    )


def test_a_late_frame_counts_until_it_is_latched() -> None:
    late = frame(1, late=True, t_latch_us=1400, consequence=HELD)
    assert effect_of(frame(0), late, frame(2)).away_ms == 0.4


def test_one_that_is_late_by_more_than_a_period_is_not_counted_twice() -> None:
    late = frame(1, late=True, t_latch_us=3500, consequence=HELD)
    assert effect_of(frame(0), late, frame(2), frame(3)).away_ms == 1.0


def test_a_wrong_drive_counts_from_its_latch_with_its_own_pressure() -> None:
    wrong = frame(1, status=FrameStatus.WRONG_DRIVE, coherence=0.5)
    late = dataclasses.replace(wrong, t_latch_us=1200, late=True)
    found = effect_of(frame(0), wrong, frame(2))
    assert effect_of(frame(0), late, frame(2)).away_ms == 1.0  # and before it, what was held
    assert (found.away_ms, found.radiated_pa) == (1.0, 2000.0)
    assert found.farthest_mm == pytest.approx(5e-4**0.5)


def test_wrong_drives_that_follow_each_other_are_one_time_wherever_the_carrier_stands() -> None:
    wrong = [frame(n, status=FrameStatus.WRONG_DRIVE, t_latch_us=1000 * n + 7 * n) for n in (1, 2)]
    assert effect_of(frame(0), *wrong, frame(3)).longest_ms == 2.0


def test_times_without_a_known_pressure_stay_out_of_its_average() -> None:
    found = effect_of(frame(0), lost(1, None), lost(2))
    assert (found.away_ms, found.radiated_pa) == (2.0, 1000.0)
    assert effect_of(frame(0), lost(1, None)).radiated_pa is None


def test_frames_without_a_time_are_left_out() -> None:
    assert RunConsequences.of([frame(0, t_apply_us=None, status=FrameStatus.OFF_TARGET)]) is None


def test_another_drive_of_which_only_the_crc_was_seen_counts_without_a_pressure() -> None:
    unseen = frame(1, status=FrameStatus.CORRUPT, coherence=None, lateral_error_mm=None)
    found = effect_of(frame(0), unseen, frame(2))
    assert (found.away_ms, found.silent_ms) == (1.0, 0.0)
    assert (found.farthest_mm, found.radiated_pa, found.intended_pa) == (None, None, None)
    seen = frame(1, status=FrameStatus.CORRUPT, criteria={"S1": True})  # its focus is in its place
    assert RunConsequences.of([frame(0), seen, frame(2)]) is None


FOUR = [frame(number) for number in range(4)]
NEXT_STREAM = [frame(5000 + number) for number in range(3)]


def test_the_last_frame_of_a_stream_is_not_due_until_the_next_stream() -> None:
    assert effect_of(*FOUR, lost(4), *NEXT_STREAM).away_ms == 1.0
    assert effect_of(*FOUR, lost(4), *NEXT_STREAM, silences=(205_000,)).away_ms == 1.0
    assert effect_of(*FOUR, lost(4), *NEXT_STREAM, silences=(4250,)).away_ms == 0.25


def test_a_first_frame_without_a_period_is_due_until_silence() -> None:
    assert effect_of(lost(0), *NEXT_STREAM, silences=(205_000,)).away_ms == 205.0
    assert effect_of(lost(0), silences=(205_000,)).away_ms == 205.0
    assert RunConsequences.of([lost(0)]) is None  # nothing tells for how long


def test_neither_rounded_times_nor_a_board_that_mutes_itself_break_a_stream() -> None:
    begins = (0, 333, 667, 1000, 1333)
    frames = [dataclasses.replace(lost(n), t_apply_us=at) for n, at in enumerate(begins)]
    found = effect_of(*frames, silences=(800,))
    assert (found.away_ms, found.longest_ms) == (1.666, 1.666)
