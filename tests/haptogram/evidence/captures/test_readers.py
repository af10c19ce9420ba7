"""Readers of captures: files typed by hand, any size of a chunk, another reader, files cut off."""

import contextlib
import tracemalloc
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.errors import ConfigurationError
from haptogram.evidence.captures import sigrok, vcd
from haptogram.evidence.captures.channel_map import ChannelMap
from haptogram.evidence.captures.files import read_capture
from haptogram.evidence.captures.pin_record import pin_record_of_capture

HEAD = '$timescale 1 ns $end\n$var wire 1 ! A $end\n$var wire 1 " B $end\n$enddefinitions $end\n'
#: File -> first level and times of the edges by channel, counted by hand.
TYPED = {
    "one change a line": (
        f'{HEAD}#0\n$dumpvars\n0!\n1"\n$end\n#5\n1!\n#9\n0!\n0"\n#20\n',
        {"A": (False, [5, 9]), "B": (True, [9])},
    ),
    "as sigrok writes it: all on a line": (
        f'{HEAD}#0 0! 1"\n#5 1!\n#9 0! 0"\n#20\n',
        {"A": (False, [5, 9]), "B": (True, [9])},
    ),
    "the first time is no 0": (
        f'{HEAD}#1000 0! 0"\n#1005 1!\n',
        {"A": (False, [5]), "B": (False, [])},
    ),
    "a value that is repeated is no edge": (
        f'{HEAD}#0 0! 0"\n#5 0! 1"\n#6 1"\n#7 1!\n',
        {"A": (False, [7]), "B": (False, [5])},
    ),
    "undefined levels change nothing": (
        f'{HEAD}#0 x! z"\n#2 0! 1"\n#5 x!\n#6 0!\n#7 1!\n',
        {"A": (False, [7]), "B": (True, [])},
    ),
    "a pulse of no width is none": (
        f'{HEAD}#0 0! 0"\n#5 1! 0!\n#6 1"\n',
        {"A": (False, []), "B": (False, [6])},
    ),
    "vectors of one bit, and identifiers like other tokens": (
        "$timescale 10 ns $end $scope module top $end $var wire 1 b A [0] $end\n"
        "$var wire 1 # B $end $var real 64 $ R $end $var wire 8 1 V [7:0] $end\n"
        "$var real 1 & S $end $var event 1 ' E $end\n"
        "$upscope $end $enddefinitions $end\n"
        "#0 b0 b b1 # r1.5 $ b10 1 r2 & 1'\n#3 b1 b\n#4 0# 0b\n#5 b11 1\n",
        {"A": (False, [3, 4]), "B": (True, [4])}
        | {"V[0]": (False, [5]), "V[1]": (True, [])}
        | {f"V[{bit}]": (False, []) for bit in range(2, 8)},
    ),
    "buses: digits that are left out, x, the other order, and a name of any alphabet": (
        "$timescale 1 ns $end $var wire 3 ! Träger [2:0] $end $var reg 2 # up[0:1] $end\n"
        "$var wire 2 $ plain $end $var integer 3000 % wide $end $enddefinitions $end\n"
        "#0 b101 ! b10 # b0 $\n#4 b1 !\n#5 bx1 # b1x $\n#7 b11 $ b0 !\n#9 b11 #\n",
        {
            "Träger[0]": (True, [7]),
            "Träger[1]": (False, []),
            "Träger[2]": (True, [4]),
            "up[0]": (True, []),
            "up[1]": (False, [5]),
            "plain[0]": (False, [7]),
            "plain[1]": (False, [5]),
        },
    ),
    "names with spaces, as Saleae writes them, and bits of a vector": (
        "$timescale 1 ns $end $scope module logic $end\r\n"
        '$var wire 1 ! Channel 0 $end\r\n$var wire 1 " Channel 1 $end\r\n'
        "$var wire 1 # d [0] $end $var wire 1 $ d [1] $end\r\n$upscope $end\r\n"
        '$enddefinitions $end\r\n#0\r\n$dumpvars\r\n0!\r\n1"\r\n0#\r\n0$\r\n$end\r\n'
        '#4\r\n1!\r\n1$\r\n#6\r\n0"\r\n$dumpoff\r\nx#\r\n$end\r\n#9\r\n',
        {
            "Channel 0": (False, [4]),
            "Channel 1": (True, [6]),
            "d[0]": (False, []),
            "d[1]": (False, [4]),
        },
    ),
    "comments and scopes": (
        "$date today $end $timescale\n 1us\n$end\n"
        "$scope module a $end $var wire 1 ! clk $end $upscope $end\n"
        '$scope module b $end $var wire 1 " clk $end $var wire 1 ! same $end $upscope $end\n'
        "$enddefinitions $end $comment #7 1! here $end\n"
        '#0 0! 0"\n$comment 1! $end\n#2 1"\n$comment\n1!\n#3\n$end\n#4 1!\n',
        {"a.clk": (False, [4]), "b.clk": (False, [2]), "same": (False, [4])},
    ),
}


def edges_of(capture):
    return {
        name: (channel.first_level, channel.times.tolist())
        for name, channel in capture.channels.items()
    }


@pytest.mark.parametrize("name", TYPED)
@pytest.mark.parametrize("size", [30, 67, 4 << 20])
def test_edges_are_those_counted_by_hand(name, size, tmp_path, monkeypatch):
    monkeypatch.setattr(vcd, "_CHUNK", size)
    text, expected = TYPED[name]
    file = tmp_path / "typed.vcd"
    file.write_text(text, encoding="utf-8")
    capture = vcd.read_vcd(file)
    assert edges_of(capture) == expected
    assert capture.cut == ""


def test_two_channels_of_one_name_are_refused(tmp_path):
    file = tmp_path / "typed.vcd"
    file.write_text(HEAD.replace(" B ", " A ") + '#0 0! 0"\n#5 1!\n')
    with pytest.raises(ConfigurationError, match="2 channels are named 'A'; give each its own"):
        vcd.read_vcd(file)


def test_undefined_levels_are_counted_and_the_scale_is_read(tmp_path):
    file = tmp_path / "typed.vcd"
    file.write_text(TYPED["undefined levels change nothing"][0])
    edges = vcd.read_vcd(file).channel("A")
    assert (edges.undefined, edges.defined_from) == (1, 2)  # the x before the first 0 is no defect
    file.write_text(f'{HEAD}#0 x! 0"\n#2 z!\n#5 x!\n')
    edges = vcd.read_vcd(file).channel("A")
    assert (edges.undefined, edges.defined_from) == (3, 0)  # never defined
    file.write_text(f'{HEAD}#0 0!\n#7 1"\n#9 0"\n')
    edges = vcd.read_vcd(file).channel("B")
    assert (edges.undefined, edges.defined_from) == (0, 7)  # no value before
    file.write_text(TYPED["comments and scopes"][0])
    assert vcd.read_vcd(file).tick_s == 1e-6


@pytest.mark.parametrize("width", ["3000", "1000000", "9" * 5000, "\N{ARABIC-INDIC DIGIT FOUR}"])
def test_a_register_of_any_width_is_left_out_and_costs_nothing(width, tmp_path):
    file = tmp_path / "wide.vcd"
    wide = f"$var reg {width} % wide [{width}:0] $end\n"
    file.write_text(f'{wide}{HEAD}#0 0! 0"\n#5 1! b1 %\n', encoding="utf-8")
    tracemalloc.start()
    assert edges_of(vcd.read_vcd(file)) == {"A": (False, [5]), "B": (False, [])}
    assert tracemalloc.get_traced_memory()[1] < 16 << 20
    tracemalloc.stop()


def test_pins_that_a_dump_tells_late_are_not_judged_before(tmp_path):
    file = tmp_path / "late.vcd"
    times = [12_500 * n for n in range(2000)]
    lines = [f"#{t}\n{k % 2}!" for k, t in enumerate(times)]
    for name in ("B", "C"):  # low all the time, and silent in the file, up to 20 ms
        sign = chr(ord(name) - 32)
        for k in range(1601, 2000):
            lines[k] += f"\n{k % 2}{sign}"
    head = HEAD.replace("$enddef", "$var wire 1 # C $end\n$enddef")
    file.write_text(head + "\n".join(lines) + "\n")
    mapped = {"reference": "A", "elements": {"B": 0, "C": 1}, "sample_rate_hz": 24e6}
    record = pin_record_of_capture(read_capture(file), ChannelMap.of("map.toml", mapped))
    for pin in record.pins.values():
        assert pin.defects == ()
        assert pin.begin == pytest.approx(800.5, abs=1.0)


@st.composite
def dumps(draw):
    """A dump of a few channels, with the levels that it was made of."""
    count = draw(st.integers(1, 5))
    steps = draw(st.lists(st.integers(1, 10**6), min_size=1, max_size=40))
    times = np.cumsum(steps).tolist()
    changes = [
        draw(st.lists(st.tuples(st.integers(0, count - 1), st.booleans()), max_size=4))
        for _ in times
    ]
    lines = [f"$var wire 1 {chr(33 + n)} D{n} $end" for n in range(count)]
    lines = ["$timescale 1 ns $end", *lines, "$enddefinitions $end", "#0"]
    lines += [f"0{chr(33 + n)}" for n in range(count)]
    levels = [[False] for _ in range(count)]
    at = [[0] for _ in range(count)]
    for t, group in zip(times, changes, strict=True):
        lines.append(f"#{t}")
        for channel, level in dict(group).items():
            lines.append(f"{int(level)}{chr(33 + channel)}")
            if level != levels[channel][-1]:
                levels[channel].append(level)
                at[channel].append(t)
    return "\n".join(lines) + "\n", {f"D{n}": (False, at[n][1:]) for n in range(count)}


@given(dumps(), st.integers(20, 200), st.randoms())
def test_a_dump_is_read_in_chunks_of_any_size_and_cut_anywhere(
    tmp_path_factory, dump, size, random
):
    text, expected = dump
    file = tmp_path_factory.mktemp("dump") / "any.vcd"
    file.write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(vcd, "_CHUNK", size)
        whole = vcd.read_vcd(file)
        assert edges_of(whole) == expected
        cut_at = random.randrange(len(text))
        file.write_text(text[:cut_at])
        if "$enddefinitions $end" not in text[:cut_at]:
            with pytest.raises(ConfigurationError, match="cut off in its header"):
                vcd.read_vcd(file)
            return
        short = vcd.read_vcd(file)
    for name, (_, times) in edges_of(short).items():
        assert times == expected[name][1][: len(times)]
    ends_in_a_line = text[cut_at - 1] != "\n" and not text[:cut_at].endswith("$end")
    assert bool(short.cut) is ends_in_a_line


def test_another_reader_finds_the_same_edges(tmp_path):
    other = pytest.importorskip("vcdvcd", reason="vcdvcd is not installed")
    random = np.random.default_rng(5)
    lines = [f"$var wire 1 {chr(33 + n)} D{n} $end\n" for n in range(16)]
    text = ["$timescale 1 ns $end\n", *lines, "$enddefinitions $end\n#0\n"]
    text += [f"0{chr(33 + n)}\n" for n in range(16)]
    for t in np.cumsum(random.integers(1, 500, 3000)).tolist():
        channel = int(random.integers(16))
        text.append(f"#{t}\n{int(random.integers(2))}{chr(33 + channel)}\n")
    file = tmp_path / "other.vcd"
    file.write_text("".join(text))
    theirs = other.VCDVCD(str(file))
    for name, channel in vcd.read_vcd(file).channels.items():
        changes = [(t, value == "1") for t, value in theirs[name].tv]
        edges = [
            t for (t, now), (_, before) in zip(changes[1:], changes, strict=False) if now != before
        ]
        assert channel.times.tolist() == edges


# --- sigrok ------------------------------------------------------------------------------------


def write_session(path, samples, *, size, chunks, deflated=True, rate="24 MHz", prefix="logic-1"):
    data = samples.astype(f"<u{size}").tobytes()
    how = zipfile.ZIP_DEFLATED if deflated else zipfile.ZIP_STORED
    probes = "".join(f"probe{bit + 1}=D{bit}\n" for bit in range(min(8 * size, 10)))
    with zipfile.ZipFile(path, "w", how) as archive:
        archive.writestr("version", "2")
        archive.writestr(
            "metadata",
            f"[global]\nsigrok version=0.5.2\n\n[device 1]\ncapturefile={prefix}\n"
            f"total probes={min(8 * size, 10)}\nsamplerate={rate}\ntotal analog=0\n{probes}"
            f"unitsize={size}\n",
        )
        if chunks == 0:
            archive.writestr(prefix, data)
        for number in range(chunks):  # not in whole samples, as it may be
            part = data[len(data) * number // chunks : len(data) * (number + 1) // chunks]
            archive.writestr(f"{prefix}-{number + 1}", part)


def expected_edges(samples, bit):
    levels = samples >> bit & 1
    return bool(levels[0]), (np.flatnonzero(np.diff(levels)) + 1).tolist()


@pytest.mark.parametrize("size", [1, 2, 4])
@pytest.mark.parametrize("chunks", [0, 1, 3, 12])
@pytest.mark.parametrize("deflated", [True, False])
def test_a_session_of_sigrok_has_the_edges_of_its_samples(size, chunks, deflated, tmp_path):
    samples = np.random.default_rng(size).integers(0, 1 << 8 * size, 997)
    file = tmp_path / "session.sr"
    write_session(file, samples, size=size, chunks=chunks, deflated=deflated)
    capture = read_capture(file)
    assert capture.stated_rate_hz == capture.sample_rate_hz == 24e6
    assert capture.tick_s == 1 / 24e6
    assert edges_of(capture) == {
        f"D{bit}": expected_edges(samples, bit) for bit in range(min(8 * size, 10))
    }


PACKED = {"stored": 0, "deflated": 8, "bzip2": 12, "lzma": 14}


def packed_session(file, samples, how, names=("D0", "D1"), more=()):
    """Write a session whose entries are packed in a way that sigrok does not use."""
    probes = "".join(f"probe{bit + 1}={name}\n" for bit, name in enumerate(names))
    about = f"[device 1]\ncapturefile=logic-1\nsamplerate=24 MHz\n{probes}unitsize=1\n"
    with zipfile.ZipFile(file, "w", how) as archive:
        archive.writestr("metadata", about)
        archive.writestr("logic-1-1", samples.astype(np.uint8).tobytes())
        for name in more:
            archive.writestr(name, b"")
    return file.read_bytes()


@pytest.mark.parametrize("how", PACKED)
@given(data=st.data())
def test_a_damaged_session_is_read_or_refused(how, data, tmp_path_factory):
    """A program that packs sessions anew may take any compression."""
    file = tmp_path_factory.mktemp("damaged") / "session.sr"
    session = packed_session(file, np.arange(3000) % 256, PACKED[how])
    for _ in range(20):
        damaged = bytearray(session)
        for at in data.draw(st.lists(st.integers(0, len(session) - 1), min_size=1, max_size=3)):
            damaged[at] = data.draw(st.integers(0, 255))
        file.write_bytes(damaged)
        with contextlib.suppress(ConfigurationError):
            read_capture(file)


def test_entries_of_other_names_are_no_samples(tmp_path):
    file = tmp_path / "session.sr"
    packed_session(file, np.arange(9), 0, more=["logic-1-" + "9" * 5000, "logic-1-x", "logic-2-1"])
    assert edges_of(read_capture(file))["D0"] == expected_edges(np.arange(9), 0)


def test_a_session_with_a_name_that_is_no_text_is_refused(tmp_path):
    file = tmp_path / "session.sr"
    session = bytearray(packed_session(file, np.arange(9), 0))
    entry = session.index(b"PK\x01\x02")
    session[entry + 9], session[entry + 46] = 8, 0xFF  # UTF-8 is said
    file.write_bytes(session)
    with pytest.raises(ConfigurationError, match="the samples are damaged"):
        read_capture(file)


def test_two_channels_of_one_name_are_refused_in_a_session(tmp_path):
    file = tmp_path / "session.sr"
    packed_session(file, np.arange(9), 0, names=("D0", "CLK", "CLK"))
    with pytest.raises(ConfigurationError, match="2 channels are named 'CLK'; give each its own"):
        read_capture(file)


@pytest.mark.parametrize("cut_at", range(0, 400, 7))
def test_a_session_cut_anywhere_is_refused_in_one_line(cut_at, tmp_path):
    file = tmp_path / "session.sr"
    write_session(file, np.arange(300) % 256, size=1, chunks=1)
    file.write_bytes(file.read_bytes()[:cut_at])
    with pytest.raises(ConfigurationError) as refusal:
        read_capture(file)
    assert "\n" not in str(refusal.value)
    assert str(file) in str(refusal.value)


REFUSED = {
    "a.vcd": (b"", "the file is empty; end the capture"),
    "a.sr": (b"no zip", "neither a VCD nor a session of sigrok"),
    "b.vcd": (b"$enddefinitions $end", "no $timescale"),
    "c.vcd": (b"$timescale 3 ns $end $enddefinitions $end", "must be 1, 10 or 100"),
    "d.vcd": (b"$timescale 1 ns $end $enddefinitions $end", "0 channels, must be 1 to 2048"),
    "e.vcd": (HEAD.encode() + b"#5 0!\n#4 1!\n", "time goes back at #4"),
    "f.vcd": (HEAD.encode() + b"#5a 0!\n", "no whole number"),
    "g.vcd": (HEAD.encode() + b"#0 0!\n#9\n", "no edge on any of 2 channels"),
    "h.sr": (b"PK\x03\x04", "no session file of sigrok"),
    "absent.sr": (None, "there is no such file"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_capture_is_refused_in_one_line(name, tmp_path):
    data, words = REFUSED[name]
    file = tmp_path / name
    if data is not None:
        file.write_bytes(data)
    with pytest.raises(ConfigurationError) as refusal:
        read_capture(file)
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rate": "fast"}, "metadata without a device"),
        ({"rate": "0 Hz"}, "sampling rate of 0"),
        ({"rate": "9" * 400 + " Hz"}, "metadata without a device"),
        ({"prefix": ""}, "no samples"),
    ],
)
def test_a_session_with_bad_metadata_is_refused(change, words, tmp_path):
    file = tmp_path / "session.sr"
    write_session(file, np.arange(9), size=1, chunks=1, **{"prefix": "logic-1"} | change)
    if "prefix" in change:
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("metadata", "[device 1]\ncapturefile=x\nsamplerate=1 MHz\nprobe1=a\n")
    with pytest.raises(ConfigurationError, match=words):
        sigrok.read_sigrok(file)


def test_a_session_that_unpacks_to_gigabytes_is_refused_before_it_is_read(tmp_path, monkeypatch):
    file = tmp_path / "session.sr"
    write_session(file, np.arange(900), size=1, chunks=2)
    monkeypatch.setattr(sigrok, "_MOST_BYTES", 400)
    with pytest.raises(ConfigurationError, match="GiB of samples, can be 0 GiB; capture a sho"):
        sigrok.read_sigrok(file)


def test_a_clock_without_pins_tells_no_sampling_rate(tmp_path):
    file = tmp_path / "clock.vcd"
    edges = "".join(f"#{12_500 * n} {n % 2}!\n" for n in range(1, 80))
    file.write_text(f'{HEAD}#0 0! 0"\n{edges}')
    mapped = {"reference": "A", "elements": {"B": 0}}
    with pytest.raises(ConfigurationError, match="reference A alone has edges, which"):
        pin_record_of_capture(read_capture(file), ChannelMap.of("map.toml", mapped))
    stated = ChannelMap.of("map.toml", mapped | {"sample_rate_hz": 24e6})
    assert pin_record_of_capture(read_capture(file), stated).samples == 600
