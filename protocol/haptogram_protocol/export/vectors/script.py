"""A dialogue as it is written down: what the host sends, what the board must answer.

The board's answers are said by whoever writes the dialogue; nothing here computes them.
"""

from __future__ import annotations

from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.messages import PhaseFormat
from haptogram_protocol.state import OutputState

from ..tables import description_hash
from .vector import SESSION, body_of, fields_of, jsonable, wire

BOOT_US: Final = 2**32 - 10_000_000  # HG-6.9
CARRIER_US: Final = 25
SIDE: Final = 2  # of the grid of the board that a dialogue is for
COUNT: Final = SIDE * SIDE
PITCH_UM: Final = 10_000
#: What a board must be like for a dialogue.
BOARD: Final = {
    "grid_nx": SIDE,
    "grid_ny": SIDE,
    "pitch_um": PITCH_UM,
    "queue_depth": 32,
    "max_horizon_us": 10_000_000,
    "max_points": 8,
}

Fields = dict[str, Any]


class Script:
    """One dialogue under construction.

    Parameters
    ----------
    name, clauses, flags, comment : str
        As in a vector; *clauses* and *flags* separated by spaces.
    session : int or None
        Session that is opened first, with its events kept quiet: no STATUS by itself. None: the
        board has just been switched on.
    """

    def __init__(
        self, name: str, clauses: str, flags: str, comment: str, *, session: int | None = SESSION
    ) -> None:
        self._name = name
        self._texts = clauses.split(), flags.split(), comment
        self._steps: list[dict[str, Any]] = []
        self._event_seq = 0
        self.t_us = 1004  # a carrier boundary: 2^32 - 10 s is not one
        self.session = 0
        self.seq = 0
        self.index = m.FIRST_STREAM_SEQ
        self.config = m.Config(status_period_ms=0)
        if session is not None:
            self.hello(session)
            self.configure()

    # --- Time ----------------------------------------------------------------------------------

    def wait(self, milliseconds: float) -> None:
        """Let time pass before the next step."""
        self.t_us += round(milliseconds * 1000)

    def wire_us(self, after_us: int = 0) -> int:
        """Return the device time *after_us* after the next step, as it stands on the wire."""
        return (BOOT_US + self.t_us + after_us) & 0xFFFFFFFF

    def boundary_us(self, after_us: int = 0) -> int:
        """Return the first carrier boundary at or after that time, on the wire."""
        t_us = BOOT_US + self.t_us + after_us
        return -(-t_us // CARRIER_US) * CARRIER_US & 0xFFFFFFFF

    # --- Host ----------------------------------------------------------------------------------

    def send(self, line: bytes) -> None:
        """Begin a step with bytes from the host; what is expected of the board comes after it."""
        self._steps.append({"at_us": self.t_us, "send": line.hex(), "expect": []})

    def look(self) -> None:
        """Begin a step without bytes: the board did something by itself up to now."""
        self._steps.append({"at_us": self.t_us, "expect": []})

    def raw(self, message: m.Message, **header: Any) -> None:
        """Send *message* with any header; what is not given is as in this dialogue."""
        fields = {"seq": self.seq, "session": self.session} | header
        self.send(wire(body_of(message, **fields)))

    def request(self, message: m.Message, **header: Any) -> None:
        """Send a request with the next sequence number."""
        self.seq = (self.seq + 1) & 0xFFFF
        self.raw(message, **{"seq": self.seq} | header)

    def stream(self, message: m.Message, **header: Any) -> int:
        """Send a stream frame with the next number, at once if no time is given; return it."""
        flags = 0 if "time_us" in header else m.Flag.IMMEDIATE
        self.raw(message, **{"seq": self.index & 0xFFFF, "flags": flags} | header)
        self.index += 1
        return self.index - 1

    # --- Board ---------------------------------------------------------------------------------

    def answer(self, message: m.Message, **header: Any) -> None:
        """Expect this answer, every field of it, to the request of this step."""
        self._answer(message.TYPE, fields_of(message), header)

    def answer_with(self, kind: m.MessageType, fields: Fields, **header: Any) -> None:
        """Expect an answer of which only some fields are known."""
        self._answer(kind, fields, header)

    def refusal(self, request: int, code: m.ErrorCode, detail: int, **header: Any) -> None:
        """Expect ERROR."""
        self.answer(m.Error(request, code, detail), **header)

    def _answer(self, kind: m.MessageType, fields: Fields, header: Fields) -> None:
        head = {"seq": self.seq, "session": self.session, "flags": 0} | header
        self._expect(kind, fields, {"time_us": self.wire_us()} | head)

    def event(self, message: m.Message, *, time_us: int | None = None, flags: int = 0) -> None:
        """Expect this event, at the time of this step unless told."""
        header = {"seq": self._event_seq, "session": self.session, "flags": flags}
        time_us = self.wire_us() if time_us is None else time_us
        self._expect(message.TYPE, fields_of(message), header | {"time_us": time_us})
        self._event_seq += 1

    def event_with(self, kind: m.MessageType, fields: Fields) -> None:
        """Expect an event of which only some fields are known."""
        self._expect(kind, fields, {"seq": self._event_seq, "session": self.session})
        self._event_seq += 1

    def _expect(self, kind: m.MessageType, fields: Fields, header: Fields) -> None:
        frame = {
            "message": kind.name,
            "header": {name: jsonable(value) for name, value in header.items()},
            "fields": {name: jsonable(value) for name, value in fields.items()},
        }
        self._steps[-1]["expect"].append(frame)

    # --- What many dialogues begin with --------------------------------------------------------

    def hello(self, session: int, *, state: OutputState = OutputState.DISARMED) -> None:
        """Open a session; everything that counts begins anew."""
        self.session, self.index, self._event_seq = session, m.FIRST_STREAM_SEQ, 0
        hello = m.Hello(m.VERSION_MAJOR, m.VERSION_MINOR, session, description_hash())
        self.request(hello, session=0)
        fields = {"major": m.VERSION_MAJOR, "nonce": session, "state": state}
        self.answer_with(m.MessageType.HELLO_REPLY, fields)

    def configure(self, **changes: Any) -> None:
        """Set the configuration: the defaults, no STATUS by itself, and *changes*."""
        self.config = self.with_changes(changes)
        self.request(m.SetConfig(self.config))
        fields = {"config": fields_of(self.config)}
        self.answer_with(m.MessageType.SET_CONFIG_REPLY, fields)

    def with_changes(self, changes: Fields) -> m.Config:
        """Return the configuration with some other values."""
        values = {name: getattr(self.config, name) for name in m.Config.WIRE}
        return m.Config(**values | changes)

    def arm(self) -> None:
        """Allow output."""
        self.request(m.Arm())
        self.answer(m.ArmReply(OutputState.ARMED))

    def counts(self, **counters: int) -> None:
        """Ask for the status and expect these counters in it."""
        self.status(counters=counters)

    def status(self, **fields: Any) -> None:
        """Ask for the status and expect these fields in it."""
        self.request(m.GetStatus())
        counters = fields.pop("counters", None)
        known = {name: jsonable(value) for name, value in fields.items()}
        if counters:
            known["counters"] = counters
        self._expect_status(known)

    def _expect_status(self, known: Fields) -> None:
        header = {"seq": self.seq, "session": self.session, "time_us": self.wire_us()}
        frame = {"message": "STATUS_REPLY", "header": header, "fields": known}
        self._steps[-1]["expect"].append(frame)

    def drive(
        self, phases: bytes, amplitudes: bytes, kind: m.DriveKind = m.DriveKind.LATCHED
    ) -> None:
        """Read the drive back and expect these codes."""
        self.request(m.ReadDrive(kind, 0, COUNT))
        data = phases + amplitudes
        self.answer_with(m.MessageType.DRIVE_REPLY, {"kind": kind, "bits": 8, "data": data})

    def may_miss(self) -> None:
        """Let the board leave out what was expected last (SHOULD)."""
        frame = self._steps[-1]["expect"][-1]
        frame["optional"] = True
        del frame["header"]["seq"]
        self._event_seq = 0  # not known any more; a dialogue with this ends soon

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


def phases(*codes: int, bits: PhaseFormat = PhaseFormat.BITS_8) -> m.Phases:
    """Return a PHASES frame of these codes."""
    return m.Phases(bits, 0, m.pack_phases(bytes(codes), bits))
