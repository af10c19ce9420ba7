import dataclasses
import json
import math

import pytest

from haptogram.acoustics import AcousticModel, NoFocus, NotSingle, SingleFocus
from haptogram.driver.driver import Driver
from haptogram.errors import ConfigurationError
from haptogram.evidence.backdoor import (
    BackdoorReader,
    is_observed_latch_of,
    observations_of_backdoor,
    observations_on_clock_of,
    observed_silences_on_clock_of,
)
from haptogram.records.frame import Evidence, FrameKey
from latched_drives import intend, seen
from sim_device.backdoor.recorder import InlineReconstructionWorker
from sim_device.backdoor.records import backdoor_record_line
from virtual_ports import BoardPort


def run(path, array=(8, 8), **settings):
    """Run a board with a back door into *path*; return driver and board."""
    port = BoardPort(model=AcousticModel.default(*array), **settings)
    with path.open("ab", buffering=0) as file:
        recorder = InlineReconstructionWorker(
            port.board.settings, lambda r: file.write(backdoor_record_line(r))
        )
        port.latch, port.notice = recorder.latch, recorder.notice
        with Driver(port) as driver:
            driver.arm()
            driver.stream([(0.01, 0.0, 0.1), (0.0, 0.02, 0.12)], 500)
        recorder.finish()
    return driver


def records_in(path):
    with BackdoorReader(str(path)) as backdoor:
        return backdoor.read()


def test_what_was_latched_comes_back_as_it_was(tmp_path):
    driver = run(tmp_path / "file")
    observations = observations_of_backdoor(records_in(tmp_path / "file"), driver.session)
    assert [o.key for o in observations] == [i.key for i in driver.intended]
    assert [o.drive for o in observations] == [i.drive for i in driver.intended]
    assert [o.drive_crc for o in observations] == [i.drive.digest() for i in driver.intended]
    assert [o.t_latch_us for o in observations] == [i.t_apply_us for i in driver.intended]
    assert {o.evidence for o in observations} == {Evidence.EXTERNAL}
    for observation, intended in zip(observations, driver.intended, strict=True):
        assert isinstance(observation.reconstruction, SingleFocus)
        miss_m = math.dist(observation.reconstruction.position_m, intended.foci[0].position_m)
        assert miss_m < 1e-3


def test_what_cannot_be_observed_is_infinitely_uncertain_again(tmp_path):
    run(tmp_path / "file", array=(64, 1))
    records = records_in(tmp_path / "file")
    found = observations_of_backdoor(records)[0].reconstruction
    assert math.isinf(max(found.bound_m))
    assert found.observable == tuple(math.isfinite(bound) for bound in found.bound_m)


def test_every_kind_of_reconstruction_survives_the_file(tmp_path):
    run(tmp_path / "file")
    records = records_in(tmp_path / "file")
    latch = next(record for record in records if record["kind"] == "latch")
    kinds = [
        SingleFocus(
            (0.0, 0.1, 0.2), (0.1, math.inf, 0.1), (0.1, math.inf, 0.1), (True, False, True),
            0.01, 0.9, 100.0, 130.0, 0.001, "warm",
        ),
        NoFocus("ramping"),
        NotSingle(0.5, (0.0, 0.0, 0.1), 12.0, 0.3, (17, 3)),
        None,
    ]  # fmt: skip
    for kind in kinds:
        fields = None if kind is None else json.loads(json.dumps(kind.as_dict()))
        (observation,) = observations_of_backdoor([latch | {"reconstruction": fields}])
        assert observation.reconstruction == kind


def test_a_line_that_is_not_whole_yet_waits(tmp_path):
    path = tmp_path / "file"
    path.touch()
    with BackdoorReader(str(path)) as backdoor, path.open("ab", buffering=0) as file:
        assert backdoor.read() == []
        file.write(b'{"kind":"board"}\n{"kind":"la')
        assert backdoor.read() == [{"kind": "board"}]
        file.write(b'tch"}\n{"kind":"end"}\n')
        assert backdoor.read() == [{"kind": "latch"}, {"kind": "end"}]


def test_records_are_found_by_their_key():
    record = {"kind": "latch", "session": 1, "sequence": 2, "loop": 3, "index": 4}
    assert is_observed_latch_of(record, FrameKey(1, 2, 3, 4))
    assert not is_observed_latch_of(record, FrameKey(1, 2, 3, 5))
    assert not is_observed_latch_of({"kind": "output"}, FrameKey(1, 2, 3, 4))


@pytest.mark.parametrize("change", [{"t_latch_us": None, "drive_crc": None}, {"phase_codes": "!"}])
def test_what_is_no_latch_record_is_refused(tmp_path, change):
    run(tmp_path / "file")
    records = records_in(tmp_path / "file")
    record = next(record for record in records if record["kind"] == "latch") | change
    del record["drive_crc"]
    with pytest.raises(ConfigurationError, match="latch record"):
        observations_of_backdoor([record])


def test_a_host_that_came_after_the_wrap_counts_from_its_own_start(tmp_path):
    driver = run(tmp_path / "file")
    records = records_in(tmp_path / "file")
    observations = observations_of_backdoor(records)
    late = [dataclasses.replace(i, t_apply_us=i.t_apply_us - 2**32) for i in driver.intended]
    shifted = observations_on_clock_of(late, observations)
    assert [o.t_latch_us for o in shifted] == [i.t_apply_us for i in late]
    assert observations_on_clock_of([], observations) == observations


@pytest.mark.parametrize("wraps", [-1, 0, 3])
def test_a_run_may_take_longer_than_the_clock_takes_to_wrap(wraps):
    """Half a wrap is 36 minutes: what comes later is not taken for what came before."""
    intended = [
        intend(AcousticModel.default(), (0.0, 0.0, 0.1), number=number, t_apply_us=t_us)
        for number, t_us in enumerate([None, *range(2**31, 2**35, 2**29)])
    ]
    early = [
        dataclasses.replace(seen(i), t_latch_us=(i.t_apply_us or 0) + wraps * 2**32)
        for i in intended
    ]
    assert [o.t_latch_us for o in observations_on_clock_of(intended, early)][1:] == [
        i.t_apply_us for i in intended[1:]
    ]
    records = [
        {"kind": "latch", **dataclasses.asdict(o.key), "t_latch_us": o.t_latch_us} for o in early
    ] + [
        {"kind": "output", "event": "ramp_ended", "restored": False, "t_us": o.t_latch_us + 5}
        for o in early[1:]
    ]
    assert observed_silences_on_clock_of(intended, records) == [
        i.t_apply_us + 5 for i in intended[1:]
    ]
