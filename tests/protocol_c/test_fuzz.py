"""The fuzzer: a bounded number of inputs, and planted faults that it must find."""

import pytest

from protocol_c.building import rebuilt, run, spoilt


@pytest.mark.parametrize("seed", [1, 2])
def test_codec_and_board_survive_bad_input(programs, seed):
    assert run(programs / "fuzz", 300, seed) == (0, "300 inputs\n")


def test_the_same_seed_gives_the_same_inputs(programs):
    assert run(programs / "fuzz", 20, 5) == run(programs / "fuzz", 20, 5)


# File, what stands there, what is planted, and whether it takes a sanitizer to see it.
PLANTED = {
    "buffer-overrun": (
        "haptogram_codec.c",
        "if (parser->length < HG_MAX_ENCODED_BYTES)",
        "if (parser->length <= HG_MAX_ENCODED_BYTES)",
        True,
    ),
    "queue-overrun": ("board/stream.c", "board->queued == BOARD_QUEUE", "0", False),
    "dropped-and-not-counted": (
        "board/judge.c",
        "link_count(board, HG_COUNTER_UNKNOWN_TYPE);",
        "(void)0;",
        False,
    ),
    "mute-watch-blind-to-a-zero": (
        "board/mute_watch.c",
        "if (watch->encoded > 1 && !watch->full)",
        "if (0)",
        False,
    ),
    "mute-watch-without-crc": (
        "board/mute_watch.c",
        "&& watch->crc == CRC_OF_FRAME_AND_ITS_CRC",
        "",
        False,
    ),
    "full-block-with-a-zero": ("board/mute_watch.c", "byte == 0xFF", "0", False),
    "timer-that-never-ends": (
        "board/output.c",
        "board->lease.deadline_us <= board->hold.deadline_us",
        "board->lease.deadline_us > board->hold.deadline_us",
        False,
    ),
}


@pytest.mark.parametrize("planted", PLANTED)
def test_a_planted_fault_is_found(tmp_path, programs, plain_programs, planted):
    *change, sanitized = PLANTED[planted]
    source = spoilt(tmp_path, *change)
    folder = rebuilt(tmp_path, programs if sanitized else plain_programs, source, "fuzz")
    status, output = run(folder / "fuzz", 1000, 1)
    assert status != 0
    assert "runtime error" in output if sanitized else "does not hold" in output
