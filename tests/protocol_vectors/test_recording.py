"""The recorded dialogues: frozen, and what a recording refuses."""

import dataclasses

import pytest

from haptogram.conformance.case import case
from haptogram.conformance.cases import all_cases, select
from haptogram.conformance.outcome import fail
from haptogram_protocol.messages import GetStatus, Mute, Ping
from protocol_vectors.vector_files import DIALOGUE_FILES, FOLDER, read, vectors
from vector_recorder.boards import PythonBoard
from vector_recorder.recorder import BOARD, LIMITS, dialogues, record, text

CASES = all_cases()
RECORDED = read("dialogues.json")["vectors"]

#: Clauses that a case judges and no dialogue holds.
NOT_RECORDED = {
    "HG-1.2/2": "the boards advertise every capability",
    "HG-1.2/3": "likewise",
    "HG-2.6/3": "runs of 20000 bytes",
    "HG-3.9/4": "a flood of 2 MB",
    "HG-4.3/5": "two lives of a board",
    "HG-6.6/3": "a fault that lasts",
    "HG-7.1/2": "the share of a slow line",
    "HG-7.4/5": "two lives of a board",
    "HG-8.7/1": "hundreds of traces",
    "HG-8.7/2": "the share of a slow line",
    "HG-9.5/1": "hundreds of traces",
}


def chapter(vector):
    return int(vector["clauses"][0][3:].split(".")[0])


@pytest.mark.sampled(4)
@pytest.mark.parametrize("number", range(1, 13))
def test_what_is_recorded_anew_is_what_was_frozen(number):
    frozen = [vector for vector in RECORDED if chapter(vector) == number]
    boards = {vector["id"]: vector["board"] for vector in frozen}
    found = dialogues(select(CASES, [f"HG-{number}"]), peer=None, boards=boards)
    assert [v["id"] for v in found] == [v["id"] for v in frozen], "run: ci/record-dialogues"
    for vector, kept in zip(found, frozen, strict=True):
        assert vector == kept, f"{vector['id']} changed; run: ci/record-dialogues"


def test_the_file_is_written_as_the_recorder_writes_it():
    assert (FOLDER / "dialogues.json").read_text("utf-8") == text(RECORDED)


def test_every_clause_that_a_case_judges_has_a_dialogue_but_for_those_named():
    judged = {case.clause for case in CASES if case.body is not None}
    held = {clause for vector in vectors(*DIALOGUE_FILES) for clause in vector["clauses"]}
    assert judged - held == set(NOT_RECORDED)


# --- What a recording is -----------------------------------------------------------------------


@case("HG-4.11/1", "PING is answered")
def pings(board):
    board.link.ask(Ping(1))


def test_a_dialogue_begins_at_power_up_and_ends_with_the_case():
    dialogue = record(pings, PythonBoard(**BOARD))
    assert dialogue["board"] == BOARD
    assert (dialogue["clauses"], dialogue["comment"]) == (["HG-4.11/1"], "PING is answered")
    *way, last = dialogue["steps"]
    assert way[0]["expect"][0]["message"] == "HELLO_REPLY"
    assert all(frame["fields"] == {} for step in way for frame in step["expect"])
    (pong,) = last["expect"]
    assert (pong["message"], pong["fields"]["echo"]) == ("PONG", "1")
    assert pong["header"].keys() == {"flags", "seq", "session", "time_us"}


class Off:
    """A board that differs from the healthy one in a bit of each answer's time."""

    def __init__(self):
        self.board = PythonBoard(**BOARD)

    def reset(self):
        self.board.reset()

    def __call__(self, at_us, data=b""):
        return self.board(at_us + (at_us > 1_000_000), data)


@case("HG-4.11/1", "PING is answered after a second")
def pings_later(board):
    board.wire.idle(1_000_000)
    board.link.ask(Ping(1))


def test_boards_that_disagree_end_the_recording():
    assert record(pings, Off()) is not None
    with pytest.raises(ValueError, match=r"HG-4.11/1: at 1001004 µs one board sent .*PONG"):
        record(pings_later, Off())


def test_a_case_that_does_not_pass_is_not_recorded():
    failing = dataclasses.replace(pings, body=lambda _: fail("no"))
    assert record(failing, None) is None
    assert record(dataclasses.replace(pings, body=None), None) is None


def test_silence_at_the_end_of_a_case_is_part_of_it():
    silent = dataclasses.replace(pings, body=lambda board: board.wire.idle(70_000))
    last = record(silent, None)["steps"][-1]
    assert last == {"at_us": 71_004, "expect": []}


def test_a_flood_is_not_recorded():
    flood = dataclasses.replace(pings, body=lambda board: board.link.send(bytes(40_000)))
    assert record(flood, None) is None


def test_a_dialogue_that_depends_on_a_limit_names_the_limits():
    def reads_the_limit(board):
        board.link.ask(Ping(board.identity.trace_ring))

    dialogue = record(dataclasses.replace(pings, body=reads_the_limit), None)
    assert dialogue["board"] == BOARD | LIMITS


def test_the_event_about_a_foreign_mute_is_optional_and_later_numbers_are_free():
    def mutes(board):
        board.configure(status_period_ms=50)
        board.arm()
        board.link.ask(Mute(), session=0)
        board.wire.idle(60_000)
        board.link.ask(GetStatus())

    steps = record(dataclasses.replace(pings, body=mutes), None)["steps"]
    events = [f for step in steps for f in step["expect"] if f["message"] in EVENTS]
    assert [(f["message"], f.get("optional", False)) for f in events] == [
        ("STATE_CHANGED", True),
        ("STATUS", False),
    ]
    assert not any("seq" in event["header"] for event in events)


EVENTS = ("STATE_CHANGED", "STATUS")


def test_cases_with_one_dialogue_share_it():
    other = dataclasses.replace(pings, clause="HG-4.11/2", summary="and says when")
    (shared,) = dialogues([pings, other], None)
    assert shared["clauses"] == ["HG-4.11/1", "HG-4.11/2"]
    assert shared["comment"] == "PING is answered; and says when"
