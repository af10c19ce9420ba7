"""A recording is read back as it was written, whole or cut off, by this program and by others."""

import contextlib
import dataclasses
import itertools
import json
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("mcap")
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.writer import Writer

from haptogram.acoustics import AcousticModel, Drive
from haptogram.cli import main
from haptogram.errors import ConfigurationError
from haptogram.evidence.recordings.channels import (
    BOARD,
    CHANNELS,
    INTENDED,
    LATCH,
    LINK,
    OUTPUT,
    RUN,
    TO_BOARD,
    TO_HOST,
    VERDICT,
    VERSION,
)
from haptogram.evidence.recordings.reader import Recording, RecordingEntry, repair_recording
from haptogram.evidence.recordings.recorded_run import record_intended, recorded_run
from haptogram.evidence.recordings.replay import replay_recording
from haptogram.evidence.recordings.writer import (
    RecordingClock,
    RecordingWriter,
    begin_recording,
)
from haptogram.records.latch import Codes, LatchRecord
from haptogram.report.viewer.recorded import viewer_scene_of_recording
from haptogram.settings.board import BoardConfig
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import Pong, build_body
from latched_drives import intend
from sim_device.driven.replay_board import VirtualReplayBoard

FRAMES = 200

drives = st.integers(0, 64).flatmap(
    lambda n: st.builds(
        Codes,
        st.binary(min_size=n, max_size=n),
        st.binary(min_size=n, max_size=n),
        st.sampled_from((5, 6, 8)),
    )
)


@st.composite
def latch_records(draw):
    latched = draw(drives)
    other = bytes(255 - code for code in latched.phases)
    radiated = Codes(other, latched.amplitudes, draw(st.sampled_from((5, 8))))
    return LatchRecord(
        draw(st.integers(0, 0xFFFF)),
        draw(st.integers(0, 0xFFFF)),
        draw(st.integers(0, 2**32 - 1)),
        draw(st.integers(0, 2**32 - 1)),
        draw(st.integers(0, 2**32 - 1)),
        draw(st.integers(0, 2**53)),
        draw(st.none() | st.integers(0, 2**53)),
        draw(st.booleans()),
        draw(st.booleans()),
        draw(st.sampled_from((5, 6, 8))),
        latched,
        draw(st.sampled_from((None, radiated))),
    )


def latch(number):
    codes = Codes(bytes([number % 256] * 16), b"\xff" * 16)
    t_us = 4_000_000_000 + number * 1000
    return LatchRecord(1, 0, 0, number, number, t_us, t_us - 400, False, False, 8, codes)


def write(path, frames=FRAMES, **options):
    with RecordingWriter(path, **options) as writer:
        for number in range(frames):
            writer.to_board(number * 1_000_000, b"frame %d" % number, waited_ns=number)
            writer.to_host(number * 1_000_000 + 500, b"reply")
            writer.latch(latch(number))
    return path


@given(latch_records())
def test_a_latch_comes_back_from_its_record(record):
    assert LatchRecord.from_record(json.loads(json.dumps(record.as_record()))) == record


def test_entries_come_back_in_order_with_their_times(tmp_path):
    configuration = {"rate_hz": 1000.0}
    recording = Recording(
        write(tmp_path / "run.mcap", command="verify", configuration=configuration)
    )
    assert recording.run["command"] == "verify"
    assert recording.run["configuration"] == configuration
    entries = list(recording.entries())
    assert recording.is_whole
    assert [entry.topic for entry in entries] == [RUN, *[TO_BOARD, TO_HOST, LATCH] * FRAMES]
    seventh = entries[1 + 3 * 7]
    assert (seventh.t_ns, seventh.published_ns) == (7_000_000, 7_000_000 - 7)
    assert seventh.data == b"frame 7"
    assert list(recording.latches()) == [latch(number) for number in range(FRAMES)]


def test_other_programs_find_channels_schemas_layout_and_times(tmp_path):
    with write(tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert reader.get_header().profile == "haptogram"
        (metadata,) = reader.iter_metadata()
        assert metadata.metadata["version"] == str(VERSION)
        channels = {channel.topic: channel for channel in summary.channels.values()}
        assert set(channels) == set(CHANNELS)
        for channel in channels.values():
            assert channel.message_encoding == "json"
            assert summary.schemas[channel.schema_id].encoding == "jsonschema"
        latches = list(reader.iter_messages(topics=[LATCH]))
        # The clock of the board is not known: its first time is that of the bytes before it.
        assert [m.log_time for _, _, m in latches] == [
            number * 1_000_000 for number in range(FRAMES)
        ]


def test_intended_frames_of_every_resolution_come_back(tmp_path):
    """A drive that comes again is written once."""
    model = AcousticModel.default(3, 4)
    drives = {bits: Drive(np.arange(12) % 2**bits, np.full(12, 255), bits) for bits in range(3, 17)}
    frames = [
        intend(model, (0.0, 0.0, 0.1), bits, number=bits, drive=drive)
        for bits, drive in drives.items()
    ]
    frames.append(dataclasses.replace(frames[2], number=17))
    with RecordingWriter(tmp_path / "run.mcap") as writer:
        record_intended(writer, model, frames)
    recording = Recording(tmp_path / "run.mcap")
    found = recorded_run(recording)
    assert (found.intended, found.incomplete) == (frames, "")
    written = [entry.fields for entry in recording.entries((INTENDED,))]
    assert ["drive_of" in fields for fields in written] == 14 * [False] + [True]


def test_records_of_the_back_door_come_back(tmp_path):
    reconstruction = {"kind": "no_focus", "reason": "muted"}
    records = [
        {"kind": "board", "boot_us": 5, "transducers": 16},
        latch(0).as_record(reconstruction),
        {"kind": "output", "t_us": 9, "event": "state", "state": "ARMED"},
        latch(1).as_record(),
        {"kind": "pulses", "number": 0, "t_latch_us": 11, "steps": 32},
        {"kind": "end", "latched": 2, "clean": True},
    ]
    path = tmp_path / "run.mcap"
    with RecordingWriter(path) as writer:
        for record in records:
            writer.record(record)
    recording = Recording(path)
    assert list(recording.records()) == records
    assert recording.board == records[0]
    (output,) = recording.entries((OUTPUT,))
    first = latch(0).t_latch_us  # with which the board's clock is set
    assert output.t_ns == max(0, 9 - first)


@pytest.fixture(scope="module")
def verified(tmp_path_factory):
    """A run of verify in virtual time: its messages as the reader of the format gives them."""
    path = tmp_path_factory.mktemp("verify") / "run.mcap"
    words = ["verify", "--virtual-time", "--quiet", "--object", "point", "--center-mm", "0,0,60"]
    more = ["--array", "4x4", "--repeat", "5", "--fault", "device.dead column=1"]
    assert main([*words, *more, "--record", str(path)]) == 1
    with path.open("rb") as file:
        return [
            (schema, channel.topic, message.log_time, json.loads(message.data))
            for schema, channel, message in make_reader(file).iter_messages()
        ]


@pytest.mark.parametrize("topic", [LINK, LATCH, OUTPUT, BOARD, VERDICT, TO_BOARD])
def test_fields_of_other_types_are_a_result_or_one_line(topic, verified, tmp_path, capsys):
    """As another program may write them: whole, with the right sums, of other types."""
    path = tmp_path / "run.mcap"
    names = {name for _, where, _, fields in verified if where == topic for name in fields}
    for name, value in zip(sorted(names), itertools.cycle((None, "x", [], 1.5))):
        with path.open("wb") as file:
            writer = Writer(file)
            ids = begin_recording(writer, "haptogram")
            for _, where, t_ns, fields in verified:
                content = fields | ({name: value} if where == topic else {})
                writer.add_message(ids[where], t_ns, json.dumps(content).encode(), t_ns)
            writer.finish()
        status = main(["replay", str(path)])
        told = capsys.readouterr().err
        assert status in (0, 1, 3) or (status, told.count("\n")) == (2, 1), (name, value)
        with contextlib.suppress(ConfigurationError):
            viewer_scene_of_recording(path)


TYPES = {"string": str, "integer": int, "number": (int, float), "boolean": bool}


def fits(about, value):
    """Whether a viewer that knows one type for each field reads the schema, and the value fits."""
    match about["type"]:
        case "object":
            read = [fits(about["properties"][name], value[name]) for name in about["properties"]
                    if name in value]  # fmt: skip
            return isinstance(value, dict) and all(read)
        case "array":
            return isinstance(value, list) and all(fits(about["items"], item) for item in value)
    return isinstance(value, TYPES[about["type"]])


def test_every_message_fits_a_schema_that_viewers_read(verified):
    assert {topic for _, topic, *_ in verified} > {"/log", "/tf", "/scene/array", "/scene/focus"}
    for schema, topic, _, fields in verified:
        about = json.loads(schema.data)
        assert fits(about, fields), topic
    for channel in CHANNELS.values():
        fits(json.loads(channel.schema), {})


def test_host_and_board_are_on_one_clock_that_begins_at_0(verified):
    times = {topic: [t for _, name, t, _ in verified if name == topic] for _, topic, *_ in verified}
    assert min(min(of) for of in times.values()) == 0
    assert max(max(of) for of in times.values()) < 10_000_000_000
    sent = [t for _, topic, t, _ in verified if topic == TO_BOARD]
    latched = [t for _, topic, t, _ in verified if topic == LATCH]
    assert sent[0] < latched[0] < latched[-1] < max(times["/to_host"])
    assert times["/verdict"] == times["/scene/focus"] == latched


def test_viewers_have_the_array_the_target_and_what_was_wrong(verified):
    (array,) = [fields for _, topic, _, fields in verified if topic == "/scene/array"]
    places = [s["pose"]["position"] for s in array["entities"][0]["spheres"]]
    assert {round(place["x"], 6) for place in places} == {-1.5, -0.5, 0.5, 1.5}  # cm
    targets = [f["entities"][0]["spheres"][0] for _, t, _, f in verified if t == "/scene/focus"]
    assert [s["pose"]["position"] for s in targets] == [{"x": 0.0, "y": 0.0, "z": 6.0}] * 5
    said = [(fields["level"], fields["message"]) for _, t, _, fields in verified if t == "/log"]
    assert any(level == 4 and "dead" in text for level, text in said)
    assert said[-1][1].startswith("FAIL: ")


@given(
    st.integers(0, 2**40),
    st.integers(0, 2**36),
    st.lists(st.integers(0, 50_000), min_size=1, max_size=40),
)
def test_replies_set_the_clock_of_a_board_to_within_the_quickest(boot_us, start_us, delays_us):
    clock = RecordingClock()
    for number, delay_us in enumerate(delays_us):
        sent_us = boot_us + number * 1000
        time_us = sent_us % 2**32
        body = build_body(Pong(number, 0, time_us), flags=0, seq=1, time_us=time_us, session=1)
        clock.hear((start_us + number * 1000 + delay_us) * 1000, encode_frame(body))
    now_us = start_us + len(delays_us) * 1000
    found_ns = clock.host_ns(boot_us + len(delays_us) * 1000, now_us * 1000)
    assert found_ns == (now_us + min(delays_us[:32])) * 1000


# --- Cut off, damaged, foreign -------------------------------------------------------------------


def kept(path):
    recording = Recording(path)
    found = list(recording.entries())
    assert not recording.is_whole
    return found


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.999])
def test_a_recording_that_is_cut_off_gives_all_that_was_flushed(share, tmp_path):
    path = write(tmp_path / "run.mcap")
    whole = list(Recording(path).entries())
    content = path.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content[: int(len(content) * share)])
    found = kept(cut)
    assert found == whole[: len(found)]
    copy = tmp_path / "copy.mcap"
    count, left_out = repair_recording(cut, copy)
    assert count == len(found)
    assert left_out.endswith("the recording was cut off")
    assert list(Recording(copy).entries()) == found
    with copy.open("rb") as file:
        assert sum(1 for _ in make_reader(file).iter_messages()) == len(found)


def error_of(path):
    """Read everything; return the one error, None if there is none."""
    try:
        recording = Recording(path)
        list(recording.records())
        list(recording.entries())
    except ConfigurationError as error:
        return str(error)
    return None


def test_a_cut_anywhere_is_no_error_but_before_the_beginning(tmp_path):
    content = write(tmp_path / "run.mcap", frames=3).read_bytes()
    cut = tmp_path / "cut.mcap"
    refused = 0
    for size in range(8, len(content), 53):
        cut.write_bytes(content[:size])
        if (error := error_of(cut)) is not None:
            refused = size
            assert "cut off before its beginning" in error
    assert refused < 300


def test_a_recording_that_is_still_written_is_read_as_far_as_it_went(tmp_path):
    path = tmp_path / "run.mcap"
    whole = write(path).read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    recording = Recording(path)
    entries = recording.entries((TO_BOARD,))
    read = [next(entries).data]
    path.write_bytes(whole)
    read += [entry.data for entry in entries]
    assert 1 < len(read) < FRAMES
    assert read == [b"frame %d" % number for number in range(len(read))]
    assert (recording.is_whole, recording.damaged) == (False, 0)


def test_damage_of_some_bytes_costs_the_part_that_they_are_in(tmp_path):
    path = write(tmp_path / "run.mcap")
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 40] = b"\xa5" * 40
    path.write_bytes(content)
    recording = Recording(path)
    found = list(recording.entries())
    assert recording.damaged == 1
    assert "1 damaged part of some 50 frames was left out" in recording.note
    assert FRAMES * 3 - 200 < len(found) < FRAMES * 3
    assert repair_recording(path, tmp_path / "copy.mcap") == (len(found), recording.note)
    assert list(Recording(tmp_path / "copy.mcap").entries()) == found


@pytest.mark.parametrize("is_cut", [False, True])
def test_damage_of_the_channels_costs_what_lies_beside_them_in_a_whole_file(is_cut, tmp_path):
    path, copy = write(tmp_path / "run.mcap"), tmp_path / "copy.mcap"
    run, *expected = Recording(path).entries()
    content = bytearray(path.read_bytes())
    at = content.index(b"haptogram.ToHost")
    content[at : at + 100] = bytes(100)
    path.write_bytes(content[: len(content) * 3 // 4] if is_cut else content)
    if is_cut:  # and the end, which repeats them
        with pytest.raises(ConfigurationError, match="no message in it can be read"):
            repair_recording(path, copy)
        assert not copy.exists()
    else:
        assert repair_recording(path, copy)[0] == len(expected)
        assert list(Recording(copy).entries()) == expected
        assert run.topic == "/run"


def test_a_repair_that_finds_no_message_writes_no_copy(tmp_path):
    path = write(tmp_path / "run.mcap")
    content = bytearray(path.read_bytes())
    begin = content.index(b"haptogram", 100)  # the metadata
    content[begin + 2000 :] = bytes(len(content) - begin - 2000)
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match="no message in it can be read"):
        repair_recording(path, tmp_path / "copy.mcap")
    assert not (tmp_path / "copy.mcap").exists()


def test_damage_between_chunks_is_one_line_and_what_lies_before_is_saved(tmp_path):
    path = write(tmp_path / "run.mcap")
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 40_000] = b"\xa5" * 40_000
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"damaged near byte .* haptogram repair saves"):
        list(Recording(path).entries())
    assert repair_recording(path, tmp_path / "copy.mcap")[0] > FRAMES


@pytest.fixture
def heard_interrupts():
    """Ctrl-C as a command hears it; a run of tests in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def idle_thread():
    """A thread beside the writer's, which gets the signals of the process too."""
    end = threading.Event()
    thread = threading.Thread(target=end.wait)
    thread.start()
    yield thread
    end.set()
    thread.join()


@pytest.mark.usefixtures("heard_interrupts")
@pytest.mark.parametrize("is_other", [False, True], ids=["own thread", "another thread"])
@pytest.mark.parametrize("step", ["start_record", "write2", "write8", "finish_record"])
def test_an_interrupt_waits_until_an_entry_is_whole(
    step, is_other, idle_thread, tmp_path, monkeypatch
):
    receiver = idle_thread if is_other else threading.current_thread()
    path = tmp_path / "run.mcap"
    usual = getattr(RecordBuilder, step)

    def interrupt(*arguments):
        signal.pthread_kill(receiver.ident, signal.SIGINT)
        time.sleep(0.01 * is_other)  # until that thread has got it
        return usual(*arguments)

    with RecordingWriter(path) as writer:
        for number in range(FRAMES):
            with monkeypatch.context() as patch:
                if number != FRAMES // 2 + 1:  # just behind a flush
                    writer.to_board(number * 1_000_000, b"frame %d" % number)
                    continue
                patch.setattr(RecordBuilder, step, interrupt)
                writer.to_board(number * 1_000_000, b"frame %d" % number)
                with pytest.raises(KeyboardInterrupt):
                    writer.flush()
    recording = Recording(path)
    frames = [entry.data for entry in recording.entries((TO_BOARD,))]
    assert frames == [b"frame %d" % number for number in range(FRAMES)]
    assert (recording.is_whole, recording.note) == (True, "")


@given(data=st.data())
def test_any_damage_is_a_result_or_the_one_error(data, tmp_path_factory):
    folder = tmp_path_factory.mktemp("damage")
    content = bytearray(write(folder / "run.mcap", frames=2).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(8, len(content) - 1))
        content[at] = data.draw(st.integers(0, 255))
    (folder / "run.mcap").write_bytes(content)
    assert "\n" not in (error_of(folder / "run.mcap") or "")


def other_program(path):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        writer.finish()


def of_version(path, version):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="haptogram")
        writer.add_metadata("haptogram", {"version": version, "library": "haptogram 9.0"})
        writer.finish()


def newer_version(path):
    of_version(path, str(VERSION + 1))


def endless_version(path):
    of_version(path, "0" * 5000)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda _: None, "there is no such file"),
        (Path.mkdir, "it is a folder"),
        (lambda path: path.write_bytes(b""), "is empty"),
        (lambda path: path.write_bytes(b"\x89MC"), "is no recording"),
        (lambda path: path.write_text("hello"), "is no recording"),
        (other_program, "of another program .profile ros2."),
        (endless_version, "version 000000000, by haptogram 9.0; .* reads 2: update haptogram"),
        (newer_version, "version 3, by haptogram 9.0; .* reads 2: update haptogram"),
        (lambda path: of_version(path, "1"), "version 1, by .* reads 2: record the run again"),
    ],
)
def test_what_is_no_recording_of_ours_is_one_line(make, message, tmp_path):
    path = tmp_path / "file.mcap"
    make(path)
    with pytest.raises(ConfigurationError, match=message) as caught:
        Recording(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    "data", [b"", b"{", b"[]", b"7", b"null", b"\xff", b"[" * 100_000, b"7" * 5000]
)
def test_an_entry_that_is_no_object_of_json_is_one_line(data):
    entry = RecordingEntry(RUN, 5, 5, data)
    with pytest.raises(ConfigurationError, match=r"of /run at 5 ns is no object of JSON") as caught:
        assert entry.fields
    assert "\n" not in str(caught.value)


def test_a_field_that_an_entry_lacks_is_one_line():
    fields = RecordingEntry(RUN, 5, 5, b'{"a": {"b": 1}}').fields
    assert fields == {"a": {"b": 1}}
    for lacking in (fields, fields["a"]):
        assert lacking.get("c") is None
        with pytest.raises(ConfigurationError, match="an entry lacks the field 'c'"):
            lacking["c"]


def replay_board(options, *, paced):
    return VirtualReplayBoard(BoardConfig.of(**options), paced=paced)


class CountedRecording(Recording):
    """A recording that counts its passes."""

    passes = 0

    def raw_records(self):
        self.passes += 1
        return super().raw_records()


def test_a_replay_reads_a_recording_of_many_openings_twice(tmp_path):
    path = tmp_path / "run.mcap"
    with RecordingWriter(path) as writer:
        for number in range(20):
            is_excerpt = number % 2
            if is_excerpt:
                writer.document(LINK, number, {"event": "excerpt", "text": f"number {number}"})
            else:
                writer.opened(number, {"array": "2x2"}, number, paced=False)
            for _ in range(number):
                writer.to_board(number, b"\0")
    recording = CountedRecording(path)
    passes, boards = recording.passes, []

    def make_board(options, *, paced):
        boards.append(replay_board(options, paced=paced))
        return boards[-1]

    result = replay_recording(recording, make_board)
    assert recording.passes - passes == 2
    assert result.notes == [
        f"an excerpt of a soak is not replayed: number {number}" for number in range(1, 20, 2)
    ]
    assert result.to_board == sum(range(0, 20, 2))
    assert len(boards) == len(result.comparisons) == 10


def test_a_replay_of_an_opening_without_its_fields_is_one_line(tmp_path):
    path = tmp_path / "run.mcap"
    with RecordingWriter(path) as writer:
        writer.document(LINK, 0, {"event": "opened"})
    with pytest.raises(ConfigurationError, match="an entry lacks the field 'board'"):
        replay_recording(Recording(path), replay_board)


def test_a_repair_never_replaces_what_it_reads(tmp_path):
    path = write(tmp_path / "run.mcap")
    with pytest.raises(ConfigurationError, match="would replace"):
        repair_recording(path, path)
    assert Recording(path).run


# --- A disk that takes no more -------------------------------------------------------------------


def test_a_full_disk_ends_the_recording_and_nothing_else():
    with RecordingWriter(Path("/dev/full")) as writer:
        assert "/dev/full: the recording ended early: the disk is full" in writer.failure
        writer.to_board(0, b"frame")
        writer.latch(latch(0))
        writer.flush()


def test_a_file_that_cannot_be_opened_is_refused_before_the_run(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigurationError, match="cannot be written"):
        RecordingWriter(tmp_path / "file" / "run.mcap")


def test_a_repair_does_not_advise_itself(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(write(path).read_bytes()[:8] + b"\xff" * 2000)
    with pytest.raises(ConfigurationError, match="haptogram repair"):
        Recording(path)
    with pytest.raises(ConfigurationError) as refused:
        repair_recording(path, tmp_path / "copy.mcap")
    assert "haptogram repair" not in str(refused.value)
