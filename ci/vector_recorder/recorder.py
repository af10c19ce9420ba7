"""From a conformance case to a dialogue: what was said, by two boards alike, in a case that passed.

A dialogue is kept if the case came to OK; both boards must send the same frames at the same times.
Every case is recorded a second time with other limits. If the dialogue is another one then, it
depends on a limit and names all of them; otherwise it fits a board of any such limits.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

from haptogram.conformance.case import Case
from haptogram.conformance.client.board_client import BoardClient
from haptogram.conformance.run.access import VirtualAccess
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.conformance.verdict import Behaviour
from haptogram_protocol.messages import MessageType
from haptogram_protocol.state import MuteReason
from wire_export.vectors import vector_document_text
from wire_export.vectors.script import BOARD

from .boards import PythonBoard, VirtualBoard
from .port import Frame, LockstepPort, Step, is_event

Dialogue = dict[str, Any]

#: Limits of the C board that only the dialogues name which depend on them.
LIMITS: Final = {
    "trace_ring": 4096,
    "max_sequence_frames": 65_536,
    "max_upload_bytes": 32 << 20,
    "max_playback_rate_hz": 10_000,
    "max_unattended_ms": 600_000,
    "max_chunk": 2048,
    "upload_window": 4,
}
#: Other limits, by which a dialogue that depends on a limit is known.
_OTHER_LIMITS: Final = {
    "trace_ring": 500,
    "max_sequence_frames": 3000,
    "max_upload_bytes": 1 << 20,
    "max_stored_bytes": 3 << 20,
    "max_playback_rate_hz": 5000,
    "max_unattended_ms": 300_000,
    "max_chunk": 1000,
    "upload_window": 3,
    "rx_window": 9000,
    "clock_ppm": 77,
}
#: What a dialogue is about, by chapter of SPEC.md.
_FLAGS: Final = {
    1: "conformance",
    2: "framing",
    3: "header",
    4: "session",
    5: "stream",
    6: "output",
    7: "configuration",
    8: "evidence",
    9: "status",
    10: "errors",
    11: "versions",
    12: "timers",
}
_BAUDRATE: Final = 50_000_000  # that the host reckons with; the lockstep port has no line
_LONGEST: Final = 64_000  # characters of JSON; a flood of megabytes is no vector to port
_SEED: Final = 1
_UNKNOWN: Final[Mapping[str, dict[str, Any]]] = MappingProxyType({})
#: The judge of these cases searches the sound field of the drive, which no dialogue shows.
_OF_THE_FIELD: Final = frozenset({"focus"})


def dialogues(
    cases: Iterable[Case],
    peer: VirtualBoard | None,
    boards: Mapping[str, dict[str, Any]] = _UNKNOWN,
) -> list[Dialogue]:
    """Return the dialogues of *cases*; cases of one chapter with the same dialogue share it.

    Parameters
    ----------
    cases : iterable of Case
        Conformance cases, in the order of their clauses.
    peer : VirtualBoard or None
        C board of the array :data:`BOARD`; None: the Python board alone answers.
    boards : mapping of str to dict, optional
        The ``board`` of dialogues by their id, where it is known: those cases are spoken once.
    """
    found: dict[str, Dialogue] = {}
    for case in cases:
        if (dialogue := record(case, peer, boards)) is None:
            continue
        spoken = json.dumps([dialogue[part] for part in ("flags", "board", "steps")])
        if (same := found.setdefault(spoken, dialogue)) is not dialogue:
            same["clauses"] = list(dict.fromkeys([*same["clauses"], case.clause]))
            same["comment"] += f"; {case.summary}"
    return list(found.values())


def record(
    case: Case, peer: VirtualBoard | None, boards: Mapping[str, dict[str, Any]] = _UNKNOWN
) -> Dialogue | None:
    """Return the dialogue of one case; None if the case did not come to OK, or is too long.

    Raises
    ------
    ValueError
        If the two boards did not send the same.
    """
    if case.body is None or case.variant in _OF_THE_FIELD or _is_of_every(case):
        return None
    usual = spoken(case, LIMITS, peer)
    if usual is None or len(json.dumps(usual)) > _LONGEST:
        return None
    name = f"dialogue/{case.id.removeprefix('HG-')}"
    if (board := boards.get(name)) is None:
        other = spoken(case, _OTHER_LIMITS, None)
        board = BOARD if usual == other else BOARD | LIMITS
    return {
        "id": name,
        "clauses": [case.clause],
        "flags": [_FLAGS[int(case.clause[3:].split(".")[0])]],
        "comment": case.summary,
        "board": board,
        "steps": usual,
    }


def _is_of_every(case: Case) -> bool:
    """Return True for a case that asks for a clause at every type and size: too long to port."""
    name = f"{getattr(case.body, '__module__', '')}.{getattr(case.body, '__name__', '')}"
    return ".every_" in name  # of the module or of the function


def spoken(
    case: Case, limits: dict[str, int], peer: VirtualBoard | None
) -> list[dict[str, Any]] | None:
    """Return the steps of *case* at a board with *limits*; None unless OK in one life of it."""
    board = PythonBoard(**BOARD, **limits)
    ports: list[LockstepPort] = []
    span, lives = [0, 0], [0, 0]

    def start(_: int) -> LockstepPort:
        ports.append(LockstepPort(board, peer))
        return ports[-1]

    def body(client: BoardClient) -> None:
        assert case.body is not None
        span[0], lives[0] = len(ports[-1].steps), len(ports)
        case.body(client)
        ports[-1].look()
        span[1], lives[1] = len(ports[-1].steps), len(ports)

    access = VirtualAccess(LockstepPort.url, start, baudrate=_BAUDRATE, virtual=True)
    runner = SuiteRunner(access, SuiteOptions(seed=_SEED))
    (result,) = runner.run([dataclasses.replace(case, body=body)]).results
    if different := next((port.disagreement for port in ports if port.disagreement), ""):
        raise ValueError(f"{case.id}: {different}")
    if result.behaviour is not Behaviour.OK or lives[0] != lives[1]:
        return None
    return _written(ports[-1].steps[: span[1]], first=span[0])


def _written(steps: list[Step], first: int) -> list[dict[str, Any]]:
    """Return steps as a vector has them; before number *first* only the messages are named.

    Those steps lead to where the case begins; other dialogues are about them.
    """
    written = []
    for number, step in enumerate(steps):
        expected = [frame if number >= first else _named(frame) for frame in step.frames]
        sent = {"send": step.sent.hex()} if step.sent else {}
        written.append({"at_us": step.at_us, **sent, "expect": expected})
    return _with_options(written)


def _named(frame: Frame) -> Frame:
    return frame | {"header": {"seq": frame["header"]["seq"]}, "fields": {}}


def _with_options(steps: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Let a board be silent about a MUTE of another session, as HG-6.8/2 leaves it free.

    The numbers of the events behind it are unknown then, up to the next session.
    """
    unknown_in = None
    for frame in (frame for step in steps for frame in step["expect"]):
        if not is_event(frame):
            continue
        changed = frame["message"] == MessageType.STATE_CHANGED.name
        if changed and frame["fields"]["reason"] == MuteReason.MUTE:
            frame["optional"] = True
            unknown_in = frame["header"]["session"]
        if unknown_in is not None and frame["header"].get("session") == unknown_in:
            del frame["header"]["seq"]
    return steps


def text(found: Sequence[Dialogue]) -> str:
    """Return the text of ``protocol/vectors/dialogues.json``."""
    return vector_document_text(
        "Dialogues of host and board, by the board's clock, recorded from conformance cases.", found
    )
