"""The healthy board passes everything, and what nothing can show is known by name."""

import dataclasses
import functools
import re
from typing import ClassVar

import pytest
from boards import WindowWatch, run, virtual
from identities import OwnDefaults, identity

from haptogram.conformance.case import Depth
from haptogram.conformance.cases import all_cases
from haptogram.conformance.client.uploads import SEQUENCES
from haptogram.conformance.verdict import Behaviour
from haptogram_protocol.framing import HEADER_BYTES, FrameDecoder
from haptogram_protocol.messages import ErrorCode, Feature, UploadCommit, UploadCommitReply
from haptogram_protocol.state import OutputState
from sim_device.board.board import Board
from sim_device.board.output import BoardOutput
from sim_device.board.refusal import RefusalError
from sim_device.board.settings import ALL_FEATURES

#: Clauses about the host, about this text, or that no line can show: never passed.
NEVER_SHOWN = {
    "HG-3.3/4",
    "HG-3.7/3",
    "HG-4.1/1",
    "HG-4.1/2",
    "HG-4.4/2",
    "HG-4.5/1",
    "HG-4.5/2",
    "HG-4.8/1",
    "HG-4.8/2",
    "HG-4.8/3",
    "HG-4.8/4",
    "HG-4.8/5",
    "HG-4.11/4",
    "HG-5.3/2",
    "HG-6.4/3",
    "HG-6.6/3",
    "HG-6.12/1",
    "HG-6.12/2",
    "HG-6.9/3",
    "HG-10.1/3",
    "HG-11.2/1",
    "HG-11.3/1",
    "HG-11.4/1",
    "HG-11.4/2",
    "HG-11.4/3",
    "HG-12.6/1",
    "HG-12.6/2",
}
#: What this board does not show: it can do everything, and its line is fast.
NOT_HERE = {"HG-1.2/2", "HG-1.2/3", "HG-7.1/2"}
#: Its line takes too long for 65 536 events, and for two frames within one carrier period.
LINE = {"HG-3.6/2", "HG-5.7/2", "HG-5.7/6", "HG-5.8/3"}
#: A drive of so few transducers fills no piece of COBS.
SMALL = {"HG-2.2/1"}


#: Of the virtual board.
RX_WINDOW = 16_384
#: High byte of the sequences of the case that fills the store.
FILLING = 0x60


class Stored(WindowWatch):
    """Notes the sequences that the board took."""

    targets: ClassVar[set[int]] = set()
    held: ClassVar[dict[str, int]] = {}

    def __init__(self, inner):
        super().__init__(inner, self.held)

    def write_some(self, data):
        for body in bodies(data):
            if body[0] == UploadCommit.TYPE:
                self.target = int.from_bytes(body[HEADER_BYTES:][:2], "little")
        return super().write_some(data)

    def read_available(self, deadline_ns):
        data = super().read_available(deadline_ns)
        if any(body[0] == UploadCommitReply.TYPE for body in bodies(data)):
            self.targets.add(self.target)
        return data


def bodies(data):
    return [body for body in FrameDecoder().feed(data) if isinstance(body, bytes)]


@functools.cache
def result(array, baud=3_000_000, depth=Depth.QUICK):
    return run(virtual(array=array, baud=baud, wrap=Stored), depth=depth)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("array", "baud", "not_here", "depth"),
    [
        pytest.param(
            *("16x16", 3_000_000, NOT_HERE | LINE, Depth.DEFAULT), marks=pytest.mark.nightly
        ),
        ("5x3", 3_000_000, NOT_HERE | SMALL, Depth.QUICK),  # leaves spare bits, and is not square
        pytest.param(  # STATUS could fill this line
            *("5x5", 115_200, NOT_HERE - {"HG-7.1/2"} | SMALL, Depth.QUICK),
            marks=pytest.mark.nightly,
        ),
    ],
)
def test_the_healthy_board_passes_everything(array, baud, not_here, depth):
    suite = result(array, baud, depth)
    wrong = {r.case: r.detail for r in suite.results if r.behaviour is Behaviour.FAILED}
    assert wrong == {}
    assert {r.case: str(r.recovery) for r in suite.results if not r.recovers} == {}
    shallow = {case.id for case in all_cases() if case.depth > depth}
    assert {r.case for r in suite.results if "this depth" in r.detail} == shallow
    silent = {
        r.clause
        for r in suite.results
        if r.behaviour is Behaviour.NOT_OBSERVED and r.case not in shallow
    }
    assert silent == NEVER_SHOWN | not_here
    others = {r.behaviour for r in suite.results}
    assert others == {Behaviour.OK, Behaviour.NOT_OBSERVED}
    assert suite.exit_status == 0
    assert {case: held for case, held in Stored.held.items() if held > RX_WINDOW} == {}
    assert suite.device["firmware"] == "haptogram-sim 1"
    correction = {0}
    stored = {target for target in Stored.targets - correction if target >> 8 != FILLING}
    assert stored <= set(SEQUENCES)


def test_the_same_seed_gives_the_same_result():
    first, second = (run(virtual(array="4x4"), "HG-5.2", seed=5) for _ in range(2))
    assert first == second


def test_a_clause_is_judged_alike_alone_and_repeated():
    suite = run(virtual(array="4x4"), "HG-6.2", "HG-4.3/5", repeat=3)
    assert {r.behaviour for r in suite.results} == {Behaviour.OK}
    assert all(len(r.seen) == 3 for r in suite.results)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("features", [Feature(0), Feature.CONFIG | Feature.READ_LATCHED])
def test_a_board_that_can_do_less_passes_what_is_left(features):
    chosen = ("HG-1", "HG-3.8", "HG-4.9", "HG-4.11", "HG-5", "HG-6.4", "HG-7", "HG-8")
    suite = run(identity(grid=(4, 4), features=features), *chosen)
    found = {r.case: r.behaviour for r in suite.results}
    assert set(found.values()) == {Behaviour.OK, Behaviour.NOT_OBSERVED, Behaviour.UNIMPLEMENTED}
    assert found["HG-1.2/2"] is found["HG-1.2/3"] is Behaviour.OK
    assert found["HG-5.4/1"] is Behaviour.UNIMPLEMENTED
    assert suite.exit_status == 0


class SmallWindow(Board):
    """Takes one longest frame without an answer: not two drives of so many transducers."""

    def __init__(self, settings, parts):
        super().__init__(dataclasses.replace(settings, rx_window=4098, max_chunk=512), parts)


def test_a_board_with_the_smallest_window_passes_bursts_that_it_has_no_room_for():
    small = virtual(array="32x32", mutant=f"{__name__}:SmallWindow")
    (result,) = run(small, "HG-5.9/1-behind").results
    assert (result.behaviour, result.detail) == (Behaviour.OK, "")


class FullStore(Board):
    """Has room for two frames, with those that an upload is to replace."""

    def __init__(self, settings, parts):
        limits = {"max_upload_bytes": 16, "max_stored_bytes": 32}
        super().__init__(dataclasses.replace(settings, **limits), parts)

    def begin_upload(self, begin):
        stored = sum(len(sequence.data) for sequence in self._sequences.values())
        self._refuse_while_playing(begin.target)
        self._uploads.begin(begin, self.settings.max_stored_bytes - stored)


def test_a_board_that_keeps_a_sequence_until_it_is_replaced_may_be_full():
    chosen = ("HG-3.4/2", "HG-4.9", "HG-6.2/1", "HG-7.1/3", "HG-7.2", "HG-7.4", "HG-10")
    results = run(virtual(array="4x4", mutant=f"{__name__}:FullStore"), *chosen).results
    wrong = (Behaviour.FAILED, Behaviour.INCONCLUSIVE)
    assert {r.case: r.detail for r in results if r.behaviour in wrong} == {}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("lasts_us", [300_000, 1 << 40])
def test_a_fault_that_lasts_refuses_disarm_and_is_no_reason_to_give_up(lasts_us):
    class LastingFault(BoardOutput):
        """Refuses DISARM until its fault is over."""

        ends_us = 0

        def raise_hardware_fault(self):
            super().raise_hardware_fault()
            self.ends_us = self.now_us + lasts_us

        def disarm(self):
            if self.state is OutputState.FAULT and self.now_us < self.ends_us:
                raise RefusalError(ErrorCode.FAULT, 1)
            super().disarm()

    results = run(identity(grid=(4, 4), output=LastingFault), "HG-6.2", "HG-6.6", "HG-6.8").results
    found = {r.case: r.behaviour for r in results if "fault" in r.summary.lower()}
    short = lasts_us < 1_000_000
    assert set(found.values()) == {Behaviour.OK if short else Behaviour.NOT_OBSERVED}
    others = {r.behaviour for r in results if r.case not in found}
    assert others <= {Behaviour.OK, Behaviour.NOT_OBSERVED}


def test_a_board_of_1024_transducers_passes_read_backs_that_its_uplink_has_no_room_for():
    results = run(virtual(array="32x32"), "HG-5.8/2").results
    assert {r.case: r.detail for r in results if r.behaviour is Behaviour.FAILED} == {}


#: What a board at these (latch_lead_us, point_time_us) passes only if every wait counts them in.
TAKES_ITS_TIME = {
    (5_000, 0): ("HG-7.6/4", "HG-10.1/1"),
    (2_000, 500): ("HG-3.4/2", "HG-3.6/1", "HG-3.8", "HG-3.9/2", "HG-5.7", "HG-6.9", "HG-9"),
    (500, 2_000): ("HG-3.4/2", "HG-3.6/1", "HG-3.8/1", "HG-5.7/3", "HG-5.8/3"),
    (0, 20_000): ("HG-5.7/6", "HG-6.4/2", "HG-6.11", "HG-7.1/3", "HG-8.4/1", "HG-12.2", "HG-12.5"),
    (20_000, 0): (
        "HG-4.6",
        "HG-5.2/6",
        "HG-6.4/2",
        "HG-7.2/5",
        "HG-7.6",
        "HG-7.7",
        "HG-8.3/2",
        "HG-9.1/2",
    ),
}


@pytest.mark.nightly
@pytest.mark.parametrize("times_us", TAKES_ITS_TIME)
def test_a_board_that_takes_its_time_passes_what_reckons_with_it(times_us):
    lead_us, point_us = times_us
    slow = virtual(array="4x4", latch_lead_us=lead_us, point_time_us=point_us)
    suite = run(slow, *TAKES_ITS_TIME[times_us])
    here = [r for r in suite.results if r.clause not in NEVER_SHOWN | NOT_HERE]
    unasked = "this depth|within one carrier period of this line"
    judged = [r for r in here if not re.search(unasked, r.detail)]
    assert {r.case: r.detail for r in judged if r.behaviour is not Behaviour.OK} == {}
    assert {r.case: str(r.recovery) for r in suite.results if not r.recovers} == {}


SLOW = (
    *("HG-3.8/4", "HG-4.6/3-playback", "HG-4.6/5-sequences", "HG-5.7/2-flushed", "HG-6.4/2"),
    *("HG-6.5/1-moments", "HG-7.4/1", "HG-7.6/2", "HG-7.6/6", "HG-7.8/1", "HG-8.2/1", "HG-9.1/2"),
)
SHORT = (
    *(
        "HG-1.2/1-dialogues",
        "HG-3.9/1-alone",
        "HG-4.6/1-moments",
        "HG-6.2/1-requests",
        "HG-7.1/3-alone",
    ),
    *("HG-7.2/7", "HG-7.2/2", "HG-7.3/1-sizes", "HG-7.6/4-most", "HG-7.6/4-offsets"),
    *("HG-10.1/1", "HG-10.2/1"),
)
NEAR = (
    "HG-2.4/2-mutes",
    "HG-3.6/1-time",
    "HG-5.7/4-lengths",
    "HG-6.6/1-fault",
    "HG-7.6/2-starts",
    "HG-8.3/2-ramp",
)


#: Limits that are allowed, together, and cases that have to reckon with more than one of them.
TOGETHER = (
    (
        {
            "features": ALL_FEATURES & ~Feature.CONFIG,
            "latch_lead_us": 20_000,
            "max_points": 74,
            "carrier_us": 100,
            "baud": 1_234_567,
            "max_playback_rate_hz": 1,
        },
        (
            *("HG-2.4/2-mutes", "HG-3.7/2-types", "HG-3.8/1-states", "HG-5.7/5-margin", "HG-6.4/2"),
            *(
                "HG-6.5/1",
                "HG-7.4",
                "HG-7.6/3",
                "HG-7.7/1",
                "HG-7.8/2",
                "HG-9.1/3-latches",
                "HG-9.3",
            ),
        ),
    ),
    (
        {
            "max_horizon_us": 2**31 - 1,
            "queue_depth": 4,
            "latch_lead_us": 333,
            "features": ALL_FEATURES & ~Feature.SEQUENCE_PHASES,
        },
        (
            *("HG-3.6/1-sides", "HG-3.8/1-queue", "HG-5.6/1", "HG-5.7/3-types", "HG-5.7/4"),
            *("HG-6.7/1-types", "HG-7.2/7"),
        ),
    ),
    (
        {
            "max_horizon_us": 100_000,
            "max_points": 250,
            "point_time_us": 100_000,
            "max_playback_rate_hz": 1,
            "max_unattended_ms": 2**32 - 1,
        },
        (
            *(
                "HG-3.4/1-stream",
                "HG-3.8/4-burst",
                "HG-5.4/2",
                "HG-5.4/3-faint",
                "HG-5.5/1",
            ),
            *("HG-5.7/5-margin", "HG-5.7/6-borders", "HG-7.6/4-most", "HG-7.8/1-many", "HG-8.7"),
        ),
    ),
    (
        {"latch_lead_us": 100_000, "carrier_us": 100, "max_horizon_us": 999_999, "queue_depth": 4},
        ("HG-5.7/2", "HG-5.7/4-lengths", "HG-5.7/6", "HG-7.1/3", "HG-12.2/1", "HG-12.5/1"),
    ),
    (
        {"max_points": 255, "baud": 115_200, "max_unattended_ms": 1000},
        ("HG-2.4/2-timers", "HG-5.7/6-first", "HG-6.7/1-others", "HG-9.1/1-whole"),
    ),
    (
        {"max_playback_rate_hz": 1, "max_unattended_ms": 1000, "grid": (1, 1)},
        (
            *("HG-3.2/4-types", "HG-3.6/4-playback", "HG-4.9/1-replies", "HG-5.8/3-pairs"),
            *("HG-7.8/1-ends", "HG-12.3/1-latches"),
        ),
    ),
    ({"max_playback_rate_hz": 9}, ("HG-12.3/1-latches",)),
    (
        {"features": ALL_FEATURES & ~Feature.CONFIG, "baud": 115_200, "grid": (2, 8)},
        (
            *("HG-2.4/2-types", "HG-3.6/5-widths", "HG-3.9/3", "HG-4.6/3", "HG-4.12/1-types"),
            *("HG-5.7/2-period", "HG-8.6/1-spans"),
        ),
    ),
    (
        {"features": ALL_FEATURES & ~Feature.TRACE, "trace_ring": 16, "queue_depth": 60},
        ("HG-5.2/6-slots",),
    ),
    (
        {"latch_lead_us": 100_000, "max_horizon_us": 100_000},
        ("HG-5.7/4", "HG-5.8/5", "HG-8.4/1-kinds"),
    ),
)


#: Limits that are 0 where the capabilities that they belong to are missing.
NO_LIMITS = dict.fromkeys(
    (
        *("trace_ring", "max_points", "max_sequence_frames", "max_upload_bytes", "max_chunk"),
        *("max_stored_bytes", "max_playback_rate_hz", "max_unattended_ms", "upload_window"),
    ),
    0,
)
CORRECTION = dict.fromkeys(("max_upload_bytes", "max_stored_bytes", "max_chunk"), 64)
LEAST = (
    NO_LIMITS | {"features": Feature(0), "carrier_us": 32},  # no millisecond is a whole number
    NO_LIMITS | {"features": Feature.CONFIG},
    NO_LIMITS | CORRECTION | {"features": Feature.CONFIG | Feature.CORRECTION, "upload_window": 1},
)


@pytest.mark.nightly
def test_dialogues_with_a_board_that_plays_points_alone_find_nothing():
    features = ALL_FEATURES & ~Feature.SEQUENCE_PHASES
    board = identity(features=features, max_unattended_ms=2**32 - 1)
    options = {"depth": Depth.DEFAULT, "explore_s": 30}
    (result,) = run(board, "HG-1.2/1-dialogues", **options).results
    assert result.behaviour is Behaviour.OK, result.detail


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("limits", "cases"),
    [
        *TOGETHER,
        ({"max_horizon_us": 100_000}, NEAR),
        *((limits | {"output": OwnDefaults}, ()) for limits in LEAST),
        ({"output": OwnDefaults}, ("HG-7.1/4",)),
        ({"grid": (32, 32), "rx_window": 4098, "max_chunk": 512}, ("HG-2.4/2-timers",)),
        ({"max_unattended_ms": 1000}, ("HG-7.6/4-long", "HG-7.8/1-many", "HG-8.4/1-many")),
        ({"max_upload_bytes": 2000, "max_stored_bytes": 3000}, ("HG-7.6/4-offsets",)),
        ({"max_upload_bytes": 16, "max_stored_bytes": 16}, ("HG-7.2", "HG-7.4", "HG-7.6")),
        ({"max_playback_rate_hz": 1}, SLOW),
        ({"max_upload_bytes": 16, "grid": (4, 4)}, SHORT),
        ({"carrier_us": 1000}, ("HG-5.2/6-slots", "HG-5.7/5-margin", "HG-5.8/1", "HG-8.3")),
    ],
)
def test_a_board_with_limits_that_are_allowed_fails_nothing(limits, cases):
    depth = Depth.DEFAULT if cases else Depth.QUICK
    results = run(identity(**limits), *cases, depth=depth).results
    wrong = (Behaviour.FAILED, Behaviour.INCONCLUSIVE)
    assert {r.case: r.detail for r in results if r.behaviour in wrong} == {}
    assert {r.case: str(r.recovery) for r in results if not r.recovers} == {}
