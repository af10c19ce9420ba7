"""Turn the JSON of a run into out/bench-wire.md: wire_report.py bench.json [--stdout]."""

import json
import sys
from pathlib import Path

from report import DOCUMENT as FIELD_DOCUMENT
from report import duration, machine, version

DOCUMENT = FIELD_DOCUMENT.with_name("bench-wire.md")

HEAD = """\
# Speed of the wire and of the virtual board

Times are processor time of one thread. Ours and the reference took
turns, round for round: a *ratio* is the median over the rounds (in brackets: the quartiles), and
only ratios compare between machines.

COBS comes in C from the package `cobs` (extra `fast`), and in Python without it. Both give the same
bytes. The goals are for C.
"""

FRAME = """\
## One phase frame

256 phases of 8 bits; *muted* has 256 amplitudes as well. *Frame* is CRC-32, COBS and both
delimiters of a body; the number is how often `zlib.crc32` of the same body could have run. Goal: at
most 5 times. *From the message* is all that the driver does for a frame; it has no goal.
"""

DECODER = """\
## Decoder of a stream

400 frames, with 30 % noise between them, in chunks of 4 KiB, against a decoder that goes byte by
byte and does the same. Goal: at least 20 times as fast, and no frame lost. On a machine whose cores
are all busy ratios of 15 to 21 were seen.
"""

MESSAGES = """\
## Every message

From message to line and back: header, payload, CRC-32 and COBS in C. Arrays hold five units, PHASES
256. The quickest and the slowest to encode are here, and PHASES; `out/bench.json` has all.
"""

WIRES = """\
## Wires of other boards

From bytes to operations, and for frames to the latches of the emulated boards with the weights of
their emitters; noise is random bytes of the same length. Goal: ten times the rate of the quickest
line that the board takes; for autd3, whose line is TCP, 5000 frames a second.
"""

WHOLE = """\
## Connections and board

Virtual time throughout. A board step is one frame through line, connection, dialect, queue and
output to its latch. A verification is `haptogram verify --virtual-time` of a circle of 26 points.
"""

OTHERS = {
    "test_round_trip_of_both_connections": "PING and PONG through both connections",
    "test_stream_frame_through_both_connections": "a phase frame through both connections",
    "test_board_step[phases]": "board step, 256 phases",
    "test_board_step[phases and amplitudes]": "board step, 256 phases and amplitudes",
    "test_board_step[focal point]": "board step, a focal point (the board computes the phases)",
    "test_writing": "recording of a frame and its latch",
    "test_recorded_board_step_against_one_that_is_not": "board step, 256 phases, recorded",
    "test_verify_in_virtual_time[phases]": "verification, phases",
    "test_verify_in_virtual_time[sequence]": "verification, sequence",
}


def main(arguments):
    data = json.loads(Path(arguments[0]).read_text())
    results = {entry["name"]: entry["extra_info"] for entry in data["benchmarks"]}
    try:
        text = page(data, results)
    except KeyError as missing:  # a name selected a part of the benchmarks
        sys.stdout.write(f"bench: {DOCUMENT.name} left as it is: {missing} was not run\n")
        return
    if "--stdout" in arguments[1:]:
        sys.stdout.write(text)
    else:
        DOCUMENT.write_text(text)
        sys.stdout.write(f"bench: wrote {DOCUMENT.name}\n")


def page(data, results):
    return "\n".join(
        [
            HEAD,
            machine(data) + f"COBS in C: cobs {version('cobs')}.\n",
            verdict(results),
            FRAME,
            frame_table(results),
            DECODER,
            decoder_table(results),
            MESSAGES,
            message_table(results),
            WIRES,
            dialect_table(results),
            WHOLE,
            other_table(results),
        ]
    )


def verdict(results):
    """Say which goals this run missed."""
    missed = [
        name.removeprefix("test_")
        for name, info in results.items()
        if "_against_crc32[" in name or "byte_by_byte[" in name
        if info["goal"] is not None and (info["ratio"] < info["goal"] or info.get("lost"))
    ]
    missed += [
        name.removeprefix("test_")
        for name, info in results.items()
        if "least" in info and info["reached"] < info["least"]
    ]
    text = "; ".join(f"`{name}`" for name in missed)
    return f"Goals that this run missed: {text or 'none'}.\n"


def frame_table(results):
    lines = [
        "| content | CRC-32 alone | frame, C | | frame, Python | | from the message, C | |",
        "|---" * 8 + "|",
    ]
    for content in contents(results):
        c, python, message = (
            results[name.format(content)]
            for name in (
                "test_frame_against_crc32[C-{}]",
                "test_frame_against_crc32[Python-{}]",
                "test_whole_frame_against_crc32[{}]",
            )
        )
        cells = [content, duration(c["reference_s"])]
        for info in (c, python, message):
            cells += [duration(info["ours_s"]), times(info)]
        lines.append(row(cells))
    return "\n".join([*lines, ""])


def times(info):
    """Return how often the reference fits into ours, where that is less than one."""
    high, low = (1 / ratio for ratio in info["ratio_quartiles"])
    return f"**{1 / info['ratio']:.2g}** ({low:.2g}–{high:.2g})"


def decoder_table(results):
    lines = ["| phases | C | ratio | lost | Python | ratio |", "|---" * 6 + "|"]
    for content in contents(results):
        cells = [content]
        for implementation in ("C", "Python"):
            info = results[f"test_stream_decoder_against_byte_by_byte[{implementation}-{content}]"]
            low, high = info["ratio_quartiles"]
            cells.append(f"{info['bytes'] / info['ours_s'] / 1e6:.0f} MB/s")
            cells.append(f"**{info['ratio']:.3g}** ({low:.3g}–{high:.3g})")
            if implementation == "C":
                cells.append(f"{info['lost']} of {info['frames']}")
        lines.append(row(cells))
    return "\n".join([*lines, ""])


def message_table(results):
    lines = ["| message | bytes on the line | encode | decode |", "|---" * 4 + "|"]
    head = "test_message[encode-"
    cost = {
        key.removeprefix(head)[:-1]: info["ours_s"]
        for key, info in results.items()
        if key.startswith(head)
    }
    shown = {"PHASES", min(cost, key=cost.get), max(cost, key=cost.get)}
    for name in (name for name in cost if name in shown):
        encode, decode = (results[f"test_message[{way}-{name}]"] for way in ("encode", "decode"))
        lines.append(
            row([name, encode["bytes"], duration(encode["ours_s"]), duration(decode["ours_s"])])
        )
    return "\n".join([*lines, ""])


def dialect_table(results):
    lines = [
        "| wire | content | bytes to operations | reached | latches |",
        "|---" * 5 + "|",
    ]
    head = "test_dialect_decoding["
    for key in (key for key in results if key.startswith(head)):
        info = results[key]
        wire, _, content = key.removeprefix(head)[:-1].rpartition("-")
        boards = results[f"test_dialect_boards[{wire}]"] if content == "frames" else {}
        cells = [wire, content, f"{info['bytes'] / info['ours_s'] / 1e6:.0f} MB/s"]
        times = "times " if info["of"] == "its line" else ""
        cells.append(f"{info['reached']:,.0f} {times}{info['of']}".replace(",", " "))
        cells.append(f"{boards['latches_per_s']:.0f} /s" if boards else "")
        lines.append(row(cells))
    return "\n".join([*lines, ""])


def other_table(results):
    lines = ["| | time |", "|---|---|"]
    lines += [row([text, duration(results[name]["ours_s"])]) for name, text in OTHERS.items()]
    return "\n".join([*lines, ""])


def contents(results):
    head = "test_stream_decoder_against_byte_by_byte[C-"
    return [key.removeprefix(head)[:-1] for key in results if key.startswith(head)]


def row(cells):
    return f"| {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    main(sys.argv[1:])
