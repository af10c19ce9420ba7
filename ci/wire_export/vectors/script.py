"""A dialogue under construction: bytes of the host, and the answers that the board owes.

Whoever writes the dialogue types the answers; nothing here computes them.
"""

from __future__ import annotations

from typing import Any, Final

from haptogram_protocol import messages as m

from .vector import SESSION, vector_body, vector_fields_of, vector_json, vector_wire

_BOOT_US: Final = 2**32 - 10_000_000  # HG-6.9
#: The array and the limits of the board that a dialogue is for.
BOARD: Final = {
    "grid_nx": 2,
    "grid_ny": 2,
    "pitch_um": 10_000,
    "queue_depth": 32,
    "max_horizon_us": 10_000_000,
    "max_points": 8,
}

_Fields = dict[str, Any]


class DialogueScript:
    """One dialogue with a board that has just been switched on.

    Parameters
    ----------
    name, clauses, flags, comment : str
        As in a vector; *clauses* and *flags* separated by spaces.

    Attributes
    ----------
    t_us : int
        Time of the next step, microseconds after power-up.
    session : int
        Session in the header of the next frame.
    seq : int
        Number of the last request.
    """

    def __init__(self, name: str, clauses: str, flags: str, comment: str) -> None:
        self._name = name
        self._texts = clauses.split(), flags.split(), comment
        self._steps: list[dict[str, Any]] = []
        self.t_us = 1004  # a carrier boundary: 2^32 - 10 s is not one
        self.session = 0
        self.seq = 0

    @property
    def wire_us(self) -> int:
        """Device time of the next step as it stands on the wire."""
        return (_BOOT_US + self.t_us) & 0xFFFFFFFF

    def send(self, line: bytes) -> None:
        """Begin a step with bytes of the host; the answers to them follow."""
        self._steps.append({"at_us": self.t_us, "send": line.hex(), "expect": []})

    def look(self) -> None:
        """Begin a step without bytes: the board did something by itself up to now, or nothing."""
        self._steps.append({"at_us": self.t_us, "expect": []})

    def raw(self, message: m.Message, **header: Any) -> None:
        """Send *message*; a header field that is not given is that of the dialogue."""
        fields = {"seq": self.seq, "session": self.session} | header
        self.send(vector_wire(vector_body(message, **fields)))

    def request(self, message: m.Message, **header: Any) -> None:
        """Send a request with the next number."""
        self.seq = (self.seq + 1) & 0xFFFF
        self.raw(message, **{"seq": self.seq} | header)

    def answer(self, message: m.Message, **header: Any) -> None:
        """Expect this message, with every field of it."""
        self.answer_with(message.TYPE, vector_fields_of(message), **header)

    def answer_with(self, kind: m.MessageType, fields: _Fields, **header: Any) -> None:
        """Expect a message of which only some fields are known."""
        known = {"time_us": self.wire_us, "seq": self.seq, "session": self.session, "flags": 0}
        frame = {
            "message": kind.name,
            "header": {name: vector_json(value) for name, value in (known | header).items()},
            "fields": {name: vector_json(value) for name, value in fields.items()},
        }
        self._steps[-1]["expect"].append(frame)

    def refusal(self, request: int, code: m.ErrorCode, detail: int, **header: Any) -> None:
        """Expect ERROR."""
        self.answer(m.Error(request, code, detail), **header)

    def open_session(self) -> None:
        """Open a session; no STATUS is sent by itself in it."""
        self.session = SESSION
        hello = m.Hello(m.VERSION_MAJOR, m.VERSION_MINOR, SESSION)
        self.request(hello, session=0)
        self.answer_with(m.MessageType.HELLO_REPLY, {"nonce": SESSION})
        config = m.Config(status_period_ms=0)
        self.request(m.SetConfig(config))
        self.answer_with(m.MessageType.SET_CONFIG_REPLY, {"config": vector_fields_of(config)})

    def finish(self) -> dict[str, Any]:
        """Return the dialogue as a vector."""
        clauses, flags, comment = self._texts
        return {
            "id": f"dialogue/{self._name}",
            "clauses": clauses,
            "flags": flags,
            "comment": comment,
            "board": BOARD,
            "steps": self._steps,
        }
