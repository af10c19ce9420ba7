import dataclasses
import itertools

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, Drive, NoFocus
from haptogram.driver.driver import Driver
from haptogram.errors import ConfigurationError
from haptogram.evidence.recordings.record_file import RecordFile, read_records
from haptogram.records.frame import Evidence, Focus, FrameKey, Observation
from haptogram_protocol.messages import TraceMode
from virtual_ports import BoardPort

MODEL = AcousticModel.default(4, 4)
ANGLE = np.linspace(0.0, 6.0, 50)
CIRCLE = np.column_stack((0.03 * np.cos(ANGLE), 0.03 * np.sin(ANGLE), np.full(50, 0.12)))
PAIRS = [[Focus.at(a), Focus.at(b, 0.5, 1.25)] for a, b in itertools.pairwise(CIRCLE[:9])]


def driven(path, trace=TraceMode.DRIVE, keep=None):
    with RecordFile(path) as file:
        port = BoardPort(model=MODEL)
        with Driver(port, seed=1, trace=trace, keep=keep, sink=file) as driver:
            driver.arm()
            driver.stream(CIRCLE, 500, loops=3)
            driver.stream(PAIRS, 500, mode="points")
            driver.stream(PAIRS, 500, mode="drives", solver="naive")
            driver.focus((0.0, 0.01, 0.1))
            driver.play(CIRCLE, 500, loops=2)
    return driver


@pytest.mark.parametrize("trace", [TraceMode.CRC, TraceMode.DRIVE, TraceMode.RING])
def test_what_was_written_is_what_is_read(tmp_path, trace):
    driver = driven(tmp_path / "record", trace)
    records = read_records(tmp_path / "record")
    assert driver.intended == records.intended
    assert driver.observations == records.observations
    assert len(records.intended) == 150 + 8 + 8 + 1 + 100


def test_what_repeats_is_written_once(tmp_path):
    driven(tmp_path / "record")
    text = (tmp_path / "record").read_text()
    intended = [line for line in text.splitlines() if '"kind":"intended"' in line]
    assert len(intended) == 267
    drives = len({frame.drive for frame in read_records(tmp_path / "record").intended})
    assert sum("phase_codes" in line for line in intended) == drives < 70


def test_a_drive_that_is_forgotten_is_written_again(tmp_path, monkeypatch):
    monkeypatch.setattr("haptogram.evidence.recordings.record_file._DRIVES", 7)
    driver = driven(tmp_path / "record", keep=3)
    records = read_records(tmp_path / "record")
    assert len(records.intended) == driver.intended.total == 267
    assert records.intended[-3:] == driver.intended
    assert [i.number for i in records.intended] == list(range(267))
    assert (
        records.intended[5].drive == records.intended[55].drive == records.intended[167 + 5].drive
    )


def last_line_lost(text):
    return text[: text.rindex('{"kind":"end"')]


@pytest.mark.parametrize(
    ("damage", "told"),
    [
        (last_line_lost, "has no end: its writer was cut off"),
        (lambda text: text[:-300], "not a line of a record"),
        (lambda text: text.replace('"kind":"intended"', '"kind":"other"', 1), "KeyError"),
        (
            lambda text: "\n".join(text.split("\n")[:100] + text.split("\n")[101:]),
            "recording lacks",
        ),
        (lambda text: text + text, "a line after the end"),
        (lambda _: "5\n", "not a line"),
        (lambda _: "", "has no end"),
    ],
)
def test_a_record_that_is_not_whole_is_refused(tmp_path, damage, told):
    driven(tmp_path / "record")
    text = (tmp_path / "record").read_text()
    (tmp_path / "record").write_text(damage(text))
    with pytest.raises(ConfigurationError, match=told):
        read_records(tmp_path / "record")


@pytest.mark.parametrize("make", [RecordFile, read_records])
def test_a_file_that_cannot_be_is_named(make, tmp_path):
    with pytest.raises(ConfigurationError, match="nowhere"):
        make(tmp_path / "nowhere" / "record")
    with pytest.raises(ConfigurationError, match="path is 5"):
        make(5)


def test_what_a_file_cannot_hold_is_refused(tmp_path):
    drive = Drive.from_weights(np.ones(16))
    seen = Observation(FrameKey.of_stream(1, 2), 0, False, Evidence.EXTERNAL, drive)
    with RecordFile(tmp_path / "records") as file:
        file(seen)
        for fields in ({"radiated": drive}, {"reconstruction": NoFocus("muted")}):
            with pytest.raises(ConfigurationError, match="what was radiated"):
                file(dataclasses.replace(seen, **fields))
