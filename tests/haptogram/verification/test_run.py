"""A run: joined by key, every frame accounted for once, a verdict that follows its rules."""

import dataclasses
import json
import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel, Drive, focus_phases
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Evidence, FrameKey
from haptogram.records.losses import BoardLosses
from haptogram.verification import Cut, FrameStatus, RunVerdict, Verdict, verify_run
from latched_drives import SESSION, drive_of, intend, registers, seen
from oracles import circular_piston, field

MODEL = AcousticModel.default(8, 8)
AWAY_M = (0.0, 0.0, 0.02)  # further than any rounding


def target(number):
    """Place of a frame: off every plane of symmetry, different for each."""
    return (0.005 + 0.001 * number, -0.011 - 0.0007 * number, 0.08 + 0.0005 * number)


def intended_frames(count):
    return [intend(MODEL, target(number), number=number) for number in range(count)]


def verify(intended, observations, **options):
    return verify_run(intended, observations, model=MODEL, **options)


def by_crc(frame, crc=None):
    """See the CRC only, by default that of the intended drive."""
    digest = frame.drive.digest() if crc is None else crc
    only = seen(frame, evidence=Evidence.SELF_REPORTED, drive_crc=digest)
    return dataclasses.replace(only, drive=None)


def wrong_sign(frame):
    return drive_of(-frame.drive.phase_codes.astype(int))


def elsewhere(frame):
    return registers(focus_phases(MODEL, np.add(frame.foci[0].position_m, AWAY_M)))


def one_element_off(frame, codes):
    turned = frame.drive.phase_codes.astype(int)
    turned[5] += codes
    return drive_of(turned)


def one_step_off(frame):
    """Off by one step where S1 has most room left: the field does not show it."""
    codes = frame.drive.phase_codes.astype(int)
    codes += 1  # a phase that all share
    return drive_of(codes)


# What can become of a frame: what is seen of it, what it comes to, and what is counted for it.
FATES = {
    "right": lambda f: [seen(f)],
    "right by CRC": lambda f: [by_crc(f)],
    "late": lambda f: [seen(f, t_latch_us=f.t_apply_us + 25)],
    "flagged late": lambda f: [seen(f, late=True)],
    "early": lambda f: [seen(f, t_latch_us=f.t_apply_us - 1)],
    "twice": lambda f: [seen(f), seen(f, t_latch_us=f.t_apply_us + 3)],
    "lost": lambda _: [],
    "held up": lambda _: [],
    "unseen": lambda f: [dataclasses.replace(seen(f), drive=None)],
    "off target": lambda f: [seen(f, elsewhere(f))],
    "wrong drive": lambda f: [seen(f, wrong_sign(f))],
    "corrupt": lambda f: [seen(f, one_step_off(f))],
    "corrupt by CRC": lambda f: [by_crc(f, f.drive.digest() ^ 1)],
}
STATUS = {
    "lost": FrameStatus.LOST,
    "held up": FrameStatus.HELD_UP,
    "unseen": FrameStatus.NOT_VERIFIED,
    "off target": FrameStatus.OFF_TARGET,
    "wrong drive": FrameStatus.WRONG_DRIVE,
    "corrupt": FrameStatus.CORRUPT,
    "corrupt by CRC": FrameStatus.CORRUPT,
}
FAILURES = {"lost", "off target", "wrong drive", "corrupt", "corrupt by CRC", "early", "twice"}
NOT_VERIFIED = {"lost", "held up", "unseen"}
MISSED = {"lost", "held up"}


def with_fate(frame, fate):
    """Return the host's record of a frame: of one that it held up, that it was not sent."""
    latest_us = frame.t_apply_us if fate == "held up" else None
    return dataclasses.replace(frame, t_latest_us=latest_us)


def expected_counts(fates, unexpected):
    times = Counter(fates)
    return {
        "sent": len(fates),
        "latched": len(fates) - times["lost"] - times["held up"],
        "verified": len(fates) - sum(times[fate] for fate in NOT_VERIFIED),
        "on_target": sum(fate not in STATUS for fate in fates),
        "off_target": times["off target"],
        "wrong_drive": times["wrong drive"],
        "corrupt": times["corrupt"] + times["corrupt by CRC"],
        "not_verified": times["unseen"],
        "lost": times["lost"],
        "held_up": times["held up"],
        "cancelled": 0,
        "not_sent": 0,
        "not_kept": 0,
        "late": times["late"] + times["flagged late"],
        "early": times["early"],
        "duplicated": times["twice"],
        "unexpected": unexpected,
    }


def expected_verdict(fates, unexpected, min_verified):
    verified = sum(fate not in NOT_VERIFIED for fate in fates)
    if set(fates) <= MISSED and not unexpected:
        return Verdict.INCONCLUSIVE  # nothing was seen at all: who knows?
    if unexpected or FAILURES & set(fates):
        return Verdict.FAIL
    if not verified or verified < min_verified * len(fates):
        return Verdict.INCONCLUSIVE
    return Verdict.PASS


@given(
    st.lists(st.sampled_from(sorted(FATES)), max_size=8),
    st.integers(0, 2),
    st.sampled_from([0.0, 0.5, 0.9, 1.0]),
    st.randoms(use_true_random=False),
)
def test_every_frame_is_accounted_for_exactly_once(fates, unexpected, min_verified, random):
    intended = list(map(with_fate, intended_frames(len(fates)), fates))
    observations = [o for f, fate in zip(intended, fates, strict=True) for o in FATES[fate](f)]
    strangers = [intend(MODEL, target(n), number=1000 + n) for n in range(unexpected)]
    observations += [seen(stranger) for stranger in strangers]
    random.shuffle(observations)  # joined by key, not by order
    run = verify(intended, observations, min_verified=min_verified)

    assert [frame.number for frame in run.frames] == list(range(len(fates)))
    assert [frame.key for frame in run.frames] == [frame.key for frame in intended]
    wanted = [STATUS.get(fate, FrameStatus.ON_TARGET) for fate in fates]
    if set(fates) <= MISSED and not unexpected:  # without any latch, nobody could have seen one
        blind = {FrameStatus.LOST: FrameStatus.NOT_VERIFIED}
        wanted = [blind.get(status, status) for status in wanted]
    assert [frame.status for frame in run.frames] == wanted
    counts = expected_counts(fates, unexpected)
    if set(fates) <= MISSED and not unexpected:
        counts |= {"lost": 0, "not_verified": counts["lost"]}
    assert run.counts == counts
    assert run.unexpected == [stranger.key for stranger in strangers]
    assert run.verdict is expected_verdict(fates, unexpected, min_verified)
    assert run.exit_status == {"pass": 0, "fail": 1, "inconclusive": 3}[run.verdict]
    assert bool(run.reasons) is (run.verdict is not Verdict.PASS)

    result = json.loads(json.dumps(run.as_dict(), allow_nan=False))
    assert result["verdict"] == run.verdict
    assert result["frames"] == run.counts
    named = [frame["number"] for frame in result["not_on_target"]]
    assert named == [n for n, status in enumerate(wanted) if status is not FrameStatus.ON_TARGET]
    assert all(line.strip() for line in str(run).splitlines())


def test_the_same_input_gives_the_same_text():
    intended = intended_frames(6)
    observations = [o for f, fate in zip(intended, FATES, strict=False) for o in FATES[fate](f)]
    texts = {
        json.dumps(verify(intended, order).as_dict(), allow_nan=False)
        for order in (observations, observations, observations[::-1])
    }
    assert len(texts) == 1


def test_a_whole_run_passes_in_whatever_order_it_was_seen():
    intended = intended_frames(5)
    run = verify(intended, [seen(f) for f in reversed(intended)])
    assert (run.verdict, run.reasons, run.exit_status) == (Verdict.PASS, (), 0)
    assert [f.lateness_us for f in run.frames] == [0] * 5
    assert {f.evidence for f in run.frames} == {Evidence.EXTERNAL}
    assert run.as_dict()["evidence"] == "external"


def test_a_drive_under_another_key_is_not_taken_for_the_next_frame():
    first, second = intended_frames(2)
    # The board latches the second drive in the place of the first.
    run = verify([first, second], [seen(first, second.drive), seen(second)])
    assert run.frames[0].status is not FrameStatus.ON_TARGET
    assert run.frames[1].status is FrameStatus.ON_TARGET
    assert run.verdict is Verdict.FAIL


@pytest.mark.parametrize("is_crc", [False, True])
def test_the_drive_of_another_frame_is_named_by_its_frame(is_crc):
    """Of a board that swaps its two buffers too early, each frame shows the drive before it."""
    intended = intended_frames(4)
    latched = [intended[0], *intended[:-1]]
    run = verify(
        intended,
        [
            by_crc(frame, shown.drive.digest()) if is_crc else seen(frame, shown.drive)
            for frame, shown in zip(intended, latched, strict=True)
        ],
    )
    names = [(), *[(f"the drive of frame {n}",) for n in range(3)]]
    assert [frame.faults for frame in run.frames] == names


@pytest.mark.parametrize("other", [FrameKey(SESSION + 1, 0, 0, 65_520), FrameKey(SESSION, 1, 0, 0)])
def test_another_session_or_sequence_is_another_frame(other):
    (frame,) = intended_frames(1)
    run = verify([frame], [dataclasses.replace(seen(frame), key=other)])
    assert run.frames[0].status is FrameStatus.LOST
    assert run.unexpected == [other]


def test_loops_of_a_sequence_are_frames_of_their_own():
    (frame,) = intended_frames(1)
    passes = [
        dataclasses.replace(frame, number=n, key=FrameKey(SESSION, 3, n, 0)) for n in range(3)
    ]
    run = verify(passes, [seen(passes[0]), seen(passes[2])])
    assert [f.status is FrameStatus.LOST for f in run.frames] == [False, True, False]


def test_two_frames_of_one_key_are_refused():
    (frame,) = intended_frames(1)
    with pytest.raises(ConfigurationError, match=r"FrameKey\(.*\) is intended 2 times"):
        verify([frame, dataclasses.replace(frame, number=1)], [])


# --- Verdict -------------------------------------------------------------------------------------


def test_nothing_sent_is_inconclusive():
    run = verify([], [], min_verified=0.0)
    assert (run.verdict, run.exit_status) == (Verdict.INCONCLUSIVE, 3)
    assert "0 of 0 frames" in run.reasons[0]


def test_nothing_seen_is_never_passed():
    run = verify(intended_frames(3), [], min_verified=0.0)
    assert run.verdict is Verdict.INCONCLUSIVE
    assert run.as_dict()["evidence"] == []
    assert "none: no latch was seen" in str(run)


def test_a_run_that_was_cut_short_cannot_pass_but_can_fail():
    intended = intended_frames(2)
    whole = [seen(f) for f in intended]
    run = verify(intended, whole, cut=Cut("interrupted after 2 frames"))
    assert (run.verdict, run.reasons) == (Verdict.INCONCLUSIVE, ("interrupted after 2 frames",))
    broken = [seen(intended[0]), seen(intended[1], wrong_sign(intended[1]))]
    run = verify(intended, broken, cut=Cut("interrupted after 2 frames"))
    assert run.verdict is Verdict.FAIL
    assert run.reasons == ("1 frame with a wrong drive", "interrupted after 2 frames")


def test_what_was_due_after_the_mute_is_cancelled_and_what_was_due_before_is_lost():
    intended = intended_frames(6)
    muted_us = intended[3].t_apply_us
    whole = [seen(frame) for frame in intended[:3]]  # 3 was due just then: nobody cancelled it
    run = verify(intended, whole, cut=Cut("interrupted", muted_us, not_sent=4), min_verified=0.75)
    assert Counter(frame.status for frame in run.frames) == {
        FrameStatus.ON_TARGET: 3,
        FrameStatus.LOST: 1,
        FrameStatus.CANCELLED: 2,
    }
    lost = "1 of 4 frames were lost by the board, since frame 3, 3.0 ms into the run"
    assert run.reasons == (lost, "interrupted")
    result = run.as_dict()
    assert result["cancelled"] == [4, 5]
    assert [frame["number"] for frame in result["not_on_target"]] == [3]
    assert "1 lost, 0 held up, 0 late, 2 cancelled by its MUTE, 4 not sent" in str(run)
    assert run.effect is not None
    assert run.effect.away_ms == 1.0  # of the lost one only


def test_a_frame_that_was_latched_after_all_is_judged():
    intended = intended_frames(2)
    run = verify(intended, [seen(frame) for frame in intended], cut=Cut("interrupted", 0))
    assert run.counts["on_target"] == 2
    assert run.counts["cancelled"] == 0


@pytest.mark.parametrize(
    ("held_up", "min_verified", "verdict"),
    [(1, 0.9, Verdict.PASS), (2, 0.9, Verdict.INCONCLUSIVE), (1, 0.91, Verdict.INCONCLUSIVE)],
)
def test_a_share_of_the_frames_must_be_verified(held_up, min_verified, verdict):
    intended = intended_frames(10)
    asked = [with_fate(f, "held up" if f.number < held_up else "") for f in intended]
    run = verify(asked, [seen(f) for f in intended[held_up:]], min_verified=min_verified)
    assert run.verdict is verdict
    assert run.counts["held_up"] == held_up
    # They are named, whatever the verdict.
    assert [f["number"] for f in run.as_dict()["not_on_target"]] == list(range(held_up))
    if verdict is not Verdict.PASS:
        needed = f"{100 * min_verified:g} % must be: this machine held up {held_up}"
        assert run.reasons == (f"{10 - held_up} of 10 frames were verified; {needed}",)


@pytest.mark.parametrize(
    ("drive", "verdict"), [(lambda _: None, Verdict.PASS), (elsewhere, Verdict.FAIL)]
)
def test_a_latch_of_the_board_counts_whatever_was_seen_on_the_wire_before(drive, verdict):
    frames = intended_frames(3)
    seen_twice = [
        latch
        for frame in frames
        for latch in (
            seen(frame, evidence=Evidence.WIRE, t_latch_us=frame.t_apply_us - 100),
            seen(frame, drive(frame)),
        )
    ]
    run = verify(frames, seen_twice)
    assert run.verdict is verdict
    assert (run.counts["latched"], run.counts["duplicated"], run.counts["early"]) == (3, 0, 0)


@pytest.mark.parametrize("count", [100, 300])
def test_a_share_in_percent_is_reached_by_as_many_of_a_hundred(count):
    for percent in range(1, 101):
        needed = percent * count // 100
        for verified in (needed, needed - 1):
            counts = {"sent": count, "cancelled": 0, "verified": verified, "lost": 0}
            run = RunVerdict(Verdict.PASS, (), [], [], percent / 100, counts)
            assert run.too_few is (verified < needed), (percent, verified)


def test_a_lost_frame_fails_whatever_share_suffices():
    intended = intended_frames(10)
    run = verify(intended, [seen(f) for f in intended[:9]], min_verified=0.1)
    assert run.verdict is Verdict.FAIL
    assert run.reasons == (
        "1 of 10 frames were lost by the board, since frame 9, 9.0 ms into the run",
    )


@pytest.mark.parametrize("min_verified", [-0.1, 1.1, math.nan])
def test_a_share_that_is_none_is_refused(min_verified):
    with pytest.raises(ConfigurationError, match=r"min_verified is .*, must be 0 to 1"):
        verify([], [], min_verified=min_verified)


def test_a_late_frame_is_named_but_does_not_fail():
    intended = intended_frames(2)
    run = verify(intended, [seen(intended[0]), seen(intended[1], t_latch_us=1400)])
    assert run.verdict is Verdict.PASS
    (late,) = run.as_dict()["late"]
    assert (late["number"], late["lateness_us"], late["status"]) == (1, 400, "on target")
    assert "frame 1: on target; 400 µs late" in str(run)


def test_progress_counts_to_the_end():
    calls = []
    intended = intended_frames(3)
    verify(intended, [seen(intended[0])], progress=lambda done, total: calls.append((done, total)))
    assert calls == [(1, 3), (2, 3), (3, 3)]


# --- Consequence ---------------------------------------------------------------------------------


def pressure_rms_pa(drive, place):
    """RMS pressure by the oracle of the tests, which shares nothing with the program."""
    phases = 2.0 * np.pi * drive.phase_codes / 256.0
    weights = drive.amplitude_codes / 255.0 * np.exp(1j * phases)
    transducer = MODEL.transducer
    ((p, _),) = field(
        [place],
        MODEL.array.positions_m,
        MODEL.array.normals,
        weights,
        wavenumber=MODEL.wavenumber,
        absorption=MODEL.medium.absorption_np_m,
        gain=circular_piston(MODEL.wavenumber * transducer.directivity.radius_m),
        peak_strength=math.sqrt(2.0) * transducer.source_strength_pa_m,
    )
    return abs(p) / math.sqrt(2.0)


def consequence_of_losing_the_last(observations, intended, **known):
    last = verify(intended, observations, **known).frames[-1]
    assert last.status is FrameStatus.LOST
    return last.consequence


def test_a_lost_frame_leaves_the_focus_before_it():
    first, second = intended_frames(2)
    effect = consequence_of_losing_the_last([seen(first)], [first, second])
    apart_mm = 1e3 * math.dist(target(0), target(1))
    assert effect.focus_error_mm == pytest.approx(apart_mm, abs=0.5)  # the rounding of the phases
    assert effect.pressure_rms_pa == pytest.approx(pressure_rms_pa(first.drive, target(1)))
    assert effect.intended_pressure_rms_pa == pytest.approx(
        pressure_rms_pa(second.drive, target(1))
    )
    run = verify([first, second], [seen(first)])
    assert f"the focus stayed {effect.focus_error_mm:.1f} mm away" in str(run)


def test_a_late_frame_leaves_the_focus_before_it_until_it_is_latched():
    first, second = intended_frames(2)
    run = verify([first, second], [seen(first), seen(second, t_latch_us=1500)])
    effect = run.frames[1].consequence
    assert effect == consequence_of_losing_the_last([seen(first)], [first, second])


def test_what_was_held_is_what_was_latched_and_not_what_was_wanted():
    first, second = intended_frames(2)
    effect = consequence_of_losing_the_last([seen(first, elsewhere(first))], [first, second])
    held_at = np.add(target(0), AWAY_M)
    apart_mm = 1e3 * math.dist(held_at, target(1))
    assert effect.focus_error_mm == pytest.approx(apart_mm, abs=0.5)
    assert effect.pressure_rms_pa == pytest.approx(pressure_rms_pa(elsewhere(first), target(1)))


@pytest.mark.parametrize("latches", [0, 1])
def test_before_the_first_latch_and_after_silence_there_is_silence(latches):
    first, second = intended_frames(2)
    muted = seen(first, Drive.muted(64))
    known = {"losses": BoardLosses()}
    effect = consequence_of_losing_the_last([muted][:latches], [first, second], **known)
    assert (effect.focus_error_mm, effect.pressure_rms_pa) == (None, 0.0)
    assert effect.intended_pressure_rms_pa > 1000.0
    text = str(verify([first, second], [muted][:latches], **known))
    assert f"silence instead of {effect.intended_pressure_rms_pa:.0f} Pa" in text


def test_after_a_latch_of_which_only_a_crc_was_seen_the_drive_is_known_if_it_is_the_right_one():
    first, second = intended_frames(2)
    known = consequence_of_losing_the_last([by_crc(first)], [first, second])
    assert known == consequence_of_losing_the_last([seen(first)], [first, second])
    other = by_crc(first, first.drive.digest() ^ 1)
    assert consequence_of_losing_the_last([other], [first, second]) is None
    run = verify([first, second], [other])
    assert "frame 1: lost" in str(run)


def test_several_lost_in_a_row_are_further_and_further_away():
    intended = intended_frames(5)
    run = verify(intended, [seen(intended[0])])
    away = [frame.consequence.focus_error_mm for frame in run.frames[1:]]
    assert away == sorted(away)
    assert away[-1] == pytest.approx(1e3 * math.dist(target(0), target(4)), abs=0.5)


def test_what_nobody_could_see_is_not_verified_rather_than_lost():
    intended = intended_frames(4)
    observations = [seen(intended[0]), seen(intended[3], t_latch_us=3500)]
    run = verify(intended, observations, unseen="read back now and then", min_verified=0.5)
    assert (run.counts["not_verified"], run.counts["lost"]) == (2, 0)
    assert run.frames[1].note == "read back now and then"
    assert run.verdict is Verdict.PASS
    # Frame 3 was late, but who knows what was held until then?
    assert run.frames[3].late
    assert run.frames[3].consequence is None
    assert verify(intended, observations).frames[3].consequence is not None


# --- What is written -----------------------------------------------------------------------------


def test_the_result_holds_what_was_measured():
    intended = intended_frames(4)
    run = verify(intended, [seen(f, t_latch_us=f.t_apply_us + 10 + f.number) for f in intended])
    result = run.as_dict()
    assert result["lateness_us"] == pytest.approx(
        {"p50": 11.5, "p99": 12.97, "p99.9": 12.997, "max": 13.0}
    )
    lateral = [frame.lateral_error_mm for frame in run.frames]
    assert result["lateral_error_mm"]["max"] == max(lateral)
    assert result["axial_error_mm"]["max"] == max(abs(f.axial_error_mm) for f in run.frames)
    assert result["coherence"]["min"] == min(frame.coherence for frame in run.frames)
    pressures = [
        pressure_rms_pa(f.drive, v.measured_m) for f, v in zip(intended, run.frames, strict=True)
    ]
    assert result["pressure_rms_pa"]["mean"] == pytest.approx(np.mean(pressures), rel=1e-6)
    assert result["pressure_rms_pa"]["std"] == pytest.approx(np.std(pressures), rel=1e-4)
    assert result["force_mn"]["mean"] == pytest.approx(
        1e3 * np.mean([frame.force_n for frame in run.frames])
    )
    assert result["smallest_miss_mm"] == max(frame.smallest_miss_mm for frame in run.frames)


def test_evidence_of_two_kinds_is_named():
    first, second = intended_frames(2)
    run = verify([first, second], [seen(first), by_crc(second)])
    assert run.as_dict()["evidence"] == ["external", "self-reported"]


def test_the_summary_takes_many_frames_with_the_same_fault_together():
    intended = intended_frames(12)
    text = str(verify(intended, [seen(f, wrong_sign(f)) for f in intended[:-1]]))
    lines = text.splitlines()
    lost = "FAIL: 1 of 12 frames were lost by the board, since frame 11, 11.0 ms into the run; "
    assert lines[0] == f"{lost}11 frames with a wrong drive"
    named = "11 frames (0, 1, 2, 3, 4, 5, 6, 7, ...): wrong drive; opposite sign of all phases"
    assert lines[-2].strip().startswith(named)
    assert lines[-1].strip().startswith("frame 11: lost")
    assert len(lines) < 20


def test_the_summary_counts_the_frames_that_it_does_not_name():
    intended = intended_frames(12)
    observations = [seen(f, one_element_off(f, n + 20)) for n, f in enumerate(intended)]
    assert str(verify(intended, observations)).endswith("... and 4 frames more, in the JSON file")


def test_the_summary_says_why_a_frame_was_not_verified():
    (frame,) = intended_frames(1)
    text = str(verify([frame], [dataclasses.replace(seen(frame), drive=None)]))
    assert "frame 0: not verified; the latch was seen, but nothing of its drive" in text


def test_a_duplicate_is_judged_by_its_first_latch_and_fails():
    (frame,) = intended_frames(1)
    run = verify([frame], [seen(frame), seen(frame, wrong_sign(frame), t_latch_us=500)])
    assert run.frames[0].latches == 2
    assert (run.verdict, run.reasons) == (Verdict.FAIL, ("1 frame latched more than once",))
    assert [f["number"] for f in run.as_dict()["duplicated"]] == [0]


def test_a_board_that_fell_silent_holds_nothing():
    """Its timers mute it when frames stay out: then there is silence in place of the last focus."""
    intended = intended_frames(4)
    quiet_us = intended[1].t_apply_us + 500
    run = verify(intended, [seen(intended[0])], silences=[quiet_us])
    assert [frame.consequence.focus_error_mm is None for frame in run.frames[1:]] == [
        False,
        True,
        True,
    ]
    assert run.frames[2].consequence.pressure_rms_pa == 0.0
    again = verify(intended, [seen(intended[0]), seen(intended[2])], silences=[quiet_us])
    assert again.frames[3].consequence.focus_error_mm is not None  # armed, and latched again


# Silences, and frames that have no time: 100 µs, 300 ms, 1.9 s and 2 s, as a board may see them.
LATCHED_US, QUIET_US, AGAIN_US, DUE_US = 100, 300_000, 1_900_000, 2_000_000


def untimed(number):
    return intend(MODEL, target(number), number=number, t_apply_us=None)


def test_what_was_latched_after_a_silence_is_held():
    first, second = untimed(0), untimed(1)
    last = intend(MODEL, target(2), number=2, t_apply_us=DUE_US)
    latches = [seen(first, t_latch_us=LATCHED_US), seen(second, t_latch_us=AGAIN_US)]
    effect = verify([first, second, last], latches, silences=[QUIET_US]).frames[2].consequence
    apart_mm = 1e3 * math.dist(target(1), target(2))
    assert effect.focus_error_mm == pytest.approx(apart_mm, abs=0.5)
    assert effect.pressure_rms_pa == pytest.approx(pressure_rms_pa(second.drive, target(2)))
    once = verify([first, second, last], latches[:1], silences=[QUIET_US])
    assert once.frames[2].consequence.focus_error_mm is None


def test_a_frame_that_was_latched_late_after_a_silence_is_held():
    first, second, last = intended_frames(3)
    last = dataclasses.replace(last, t_apply_us=8000)
    latches = [seen(first), seen(second, t_latch_us=6000)]
    run = verify([first, second, last], latches, silences=[4000])
    assert run.frames[1].consequence.focus_error_mm is not None  # the silence came after its time
    assert run.frames[2].consequence.focus_error_mm is not None


@pytest.mark.parametrize("known_us", [QUIET_US - 1, QUIET_US, None])
def test_nobody_knows_what_was_held_when_a_frame_without_a_time_was_lost_around_a_silence(known_us):
    """It was due before the next frame that has a time, or at any time, if there is none."""
    first, second = untimed(0), untimed(1)
    after = [] if known_us is None else [intend(MODEL, target(2), number=2, t_apply_us=known_us)]
    latches = [seen(first, t_latch_us=LATCHED_US), *map(seen, after)]
    run = verify([first, second, *after], latches, silences=[QUIET_US])
    assert run.frames[1].status is FrameStatus.LOST
    assert (run.frames[1].consequence is None) is (known_us != QUIET_US - 1)


def test_a_frame_without_a_time_that_was_lost_well_after_a_silence_leaves_silence():
    first, second = untimed(0), intend(MODEL, target(1), number=1, t_apply_us=DUE_US)
    latches = [seen(first, t_latch_us=LATCHED_US)]
    run = verify([first, second, untimed(2)], latches, silences=[QUIET_US])
    assert run.frames[2].consequence.pressure_rms_pa == 0.0


def test_a_silence_ends_what_nobody_knows_as_well():
    first, second, third = intended_frames(3)
    run = verify(
        [first, second, third], [seen(first), seen(third, late=True)], unseen="now and then"
    )
    assert run.frames[2].consequence is None
    run = verify(
        [first, second, third],
        [seen(first), seen(third, late=True)],
        unseen="now and then",
        silences=[1500],
    )
    assert run.frames[2].consequence.focus_error_mm is None


def test_a_run_that_fails_by_a_crc_alone_has_an_effect():
    first, second = intended_frames(2)
    run = verify([first, second], [seen(first), by_crc(second, second.drive.digest() ^ 1)])
    assert run.verdict is Verdict.FAIL
    assert (run.effect.away_ms, run.effect.radiated_pa) == (1.0, None)
    assert "not as intended for 1.0 ms" in str(run)


def test_a_silence_ends_the_last_frame_of_a_run():
    intended = intended_frames(3)
    run = verify(intended, [seen(f) for f in intended[:2]], silences=[2400])
    assert run.effect.away_ms == 0.4
