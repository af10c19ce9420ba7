"""Reading the vectors, and comparing what a board sent with what a dialogue expects."""

import json
from pathlib import Path

from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import FrameDecoder
from haptogram_protocol.messages import EVENT_RANGE, MessageType, parse_body
from wire_export.vectors.vector import vector_fields_of

FOLDER = Path(__file__).resolve().parents[2] / "protocol" / "vectors"
FRAME_FILES = ("frames-valid.json", "frames-acceptable.json", "frames-invalid.json")
DIALOGUE_FILES = ("dialogues.json", "dialogues-typed.json")
EVERY_FILE = (*FRAME_FILES, *DIALOGUE_FILES)


def read(name):
    """The document in one file."""
    return json.loads((FOLDER / name).read_text("utf-8"))


def vectors(*names):
    """Every vector of these files."""
    return [vector for name in names for vector in read(name)["vectors"]]


def outcome(found):
    """What the Python decoder made of one body or damage, as a vector says it."""
    if isinstance(found, RemoteProtocolError):
        return {"drop": found.reason}
    size = 10
    try:
        header, message = parse_body(found)
    except RemoteProtocolError as error:
        reject = {"reject": error.reason, "offset": error.offset}
        return reject | {"header": header_fields(found[:size])}
    return {
        "frame": {
            "body": found.hex(),
            "header": vector_fields_of(header),
            "message": message.TYPE.name,
            "fields": vector_fields_of(message),
        }
    }


def header_fields(head):
    numbers = (head[0], head[1], *(int.from_bytes(head[a:b], "little") for a, b in SLICES))
    return dict(zip(("type", "flags", "seq", "time_us", "session"), numbers, strict=True))


SLICES = ((2, 4), (4, 8), (8, 10))


def play(dialogue, board):
    """Send a dialogue to *board*, a callable of time and bytes; return what was not as expected."""
    complaints = []
    for number, step in enumerate(dialogue["steps"]):
        sent = board(step["at_us"], bytes.fromhex(step.get("send", "")))
        frames = [outcome(found) for found in FrameDecoder().feed(sent)]
        complaints += [f"step {number}: {text}" for text in compare(frames, step["expect"])]
    return complaints


def compare(frames, expected):
    """Complaints about *frames*: responses are compared in order, and events in order."""
    damaged = [f"no frame: {frame}" for frame in frames if "frame" not in frame]
    taken = [frame["frame"] for frame in frames if "frame" in frame]
    for events in (False, True):
        seen = [frame for frame in taken if is_event(frame["message"]) is events]
        due = [frame for frame in expected if is_event(frame["message"]) is events]
        damaged += compare_in_order(seen, due)
    return damaged


def is_event(message):
    return MessageType[message] in EVENT_RANGE


def compare_in_order(seen, due):
    if not any(frame["message"] == "STATUS" for frame in due):
        seen = [frame for frame in seen if frame["message"] != "STATUS"]
    seen = list(seen)
    for expected in due:
        if not seen or differs(seen[0], expected):
            if not expected.get("optional"):
                yield f"expected {expected}, got {seen[0] if seen else 'nothing'}"
                return
            continue
        seen.pop(0)
    for frame in seen:
        yield f"not expected: {frame['message']} {frame['header']} {frame['fields']}"


def differs(frame, expected):
    return (
        frame["message"] != expected["message"]
        or not contains(frame["header"], expected["header"])
        or not contains(frame["fields"], expected["fields"])
    )


def contains(whole, part):
    """Whether everything that *part* says is so in *whole*."""
    if isinstance(part, dict):
        return all(key in whole and contains(whole[key], value) for key, value in part.items())
    return whole == part
