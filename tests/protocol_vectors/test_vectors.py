"""The vectors: up to date, complete, and what the Python side makes of them."""

import re
from pathlib import Path

import pytest

from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import MESSAGES
from protocol_vectors.vector_files import (
    DIALOGUE_FILES,
    EVERY_FILE,
    FOLDER,
    FRAME_FILES,
    outcome,
    play,
    read,
    vectors,
)
from vector_recorder.boards import PythonBoard
from wire_export.vectors import FILES, vector_file_text, write_vectors

SPEC = Path(__file__).resolve().parents[2] / "protocol" / "SPEC.md"
EVERY = vectors(*EVERY_FILE)
FRAMES = vectors(*FRAME_FILES)
DIALOGUES = vectors(*DIALOGUE_FILES)


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_what_the_messages_make_of_it(name):
    assert (FOLDER / name).read_text("utf-8") == vector_file_text(name), "run: ci/export-wire"


def test_writing_twice_changes_nothing(tmp_path):
    first = [path.read_bytes() for path in write_vectors(tmp_path)]
    assert [path.read_bytes() for path in write_vectors(tmp_path)] == first


def test_there_are_enough_vectors_and_each_has_its_own_name():
    names = [vector["id"] for vector in EVERY]
    assert len(names) == len(set(names)) >= 400
    assert len(DIALOGUES) >= 180


def test_every_message_is_taken_and_every_kind_of_damage_is_named():
    outcomes = [found for vector in FRAMES for found in vector["outcome"]]
    taken = {found["frame"]["message"] for found in outcomes if "frame" in found}
    assert taken == {kind.TYPE.name for kind in MESSAGES.values()}
    reasons = {found.get("drop", found.get("reject")) for found in outcomes} - {None}
    damage = {"crc", "cobs", "short", "oversize"}
    assert reasons == damage | {"bad_length", "bad_value", "unknown_type"}


def test_every_clause_is_one_of_the_spec():
    known = set(re.findall(r"HG-\d+\.\d+/\d+", SPEC.read_text("utf-8")))
    assert len(known) > 100
    assert {clause for vector in EVERY for clause in vector["clauses"]} - known == set()


@pytest.mark.parametrize("size", [1, 7, 1 << 20])
def test_the_python_decoder_agrees(size):
    for vector in FRAMES:
        line, decoder, found = bytes.fromhex(vector["line"]), FrameDecoder(), []
        for start in range(0, len(line), size):
            found += decoder.feed(line[start : start + size])
        assert [outcome(item) for item in found] == vector["outcome"], vector["id"]


def test_the_python_encoder_gives_the_bytes_of_valid_frames():
    for vector in vectors("frames-valid.json"):
        (found,) = vector["outcome"]
        assert encode_frame(bytes.fromhex(found["frame"]["body"])).hex() == vector["line"]


@pytest.mark.parametrize("dialogue", DIALOGUES, ids=lambda dialogue: dialogue["id"])
def test_the_virtual_board_answers_as_the_dialogue_says(dialogue):
    assert play(dialogue, PythonBoard(**dialogue["board"])) == []


def test_a_dialogue_can_fail():
    dialogue = next(d for d in DIALOGUES if d["id"] == "dialogue/6.2/1")
    assert play(dialogue, lambda _, __: b"") != []
    deaf = PythonBoard(**dialogue["board"])
    assert play(dialogue, lambda at_us, _: deaf(at_us, b"")) != []
    silent = {"expect": [], "at_us": 0} | {"send": dialogue["steps"][0]["send"]}
    board = PythonBoard(**dialogue["board"])
    assert play({"steps": [silent]}, board) != [], "an answer that nobody expected"


def test_the_document_says_what_it_is():
    for name in EVERY_FILE:
        assert read(name)["$schema"] == "schema.json"
