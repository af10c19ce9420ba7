"""Frames of a random host: any message, at any time, with any number, session and length."""

from __future__ import annotations

from typing import Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.framing import HEADER_BYTES, MAX_BODY_BYTES

from ..actions import LATE_WINDOWS_US, SLOT_US, DialogueAction
from ..host import NO_SESSION, DialogueHost
from .conditions import DialogueMaker

#: Due time of a frame: slots ahead, the name of a time, or at once.
At: TypeAlias = float | str | None

#: High: must be understood, and is not; low: may be ignored.
ODD_FLAGS: Final = (0x20, 0x40, 0x80, 0x01, 0x02, 0x04, 0x08, 0xFF & ~m.Flag.IMMEDIATE)
#: Differences of a wrong session: low byte the same, high byte the same, both differ.
WRONG_SESSIONS: Final = (0x0100, 0x0001, 0x8000)
#: Defects of a request, one for each check in the order of HG-3.8.
DEFECTS: Final[dict[str, dict[str, int]]] = {
    "IMMEDIATE": {"flags": m.Flag.IMMEDIATE},
    "a flag that must be understood": {"flags": 0x40},
    "a flag that may be ignored": {"flags": 0x02},
    "another session": {"session": WRONG_SESSIONS[0]},
    "no session": {"session": NO_SESSION},
    "a byte less": {"length": -1},
    "a byte more": {"length": 1},
    "300 bytes more": {"length": 300},
    "2500 bytes more": {"length": 2500},
    "no payload": {"length": -9999},
    "the last number": {"number": -1},
    "an old number": {"number": -5},
    "half of all numbers back": {"number": -0x7FFF},
    "numbers left out": {"number": 300},
    "almost half of all numbers left out": {"number": 0x7FF0},
}
#: Nonces of HELLO; what begins with 0 or another version opens no session.
HELLOS: Final = (
    *("open", "last", "earlier", "new", "near", "largest", "wrapping", "0", "next major"),
)
_FIRST_NUMBERS: Final = (0xFFFF, 0x7FFF, 0xFF, 0x100FE)
_FAR_US: Final = 4_000_000  # later than any dialogue ends
_LATCHED_AS_IT_COMES: Final = (None, "late", "too late", "at a limit")


class RandomFrames(DialogueMaker):
    """Makes frames of messages."""

    def frame(
        self,
        message: m.Message,
        at: At = 0.0,
        *,
        apart_us: int = 0,
        number: int = 0,
        flags: int = 0,
        session: int = 0,
        length: int = 0,
    ) -> DialogueAction:
        """Return a frame for a time.

        *number* is added to the next one, *length* to that of the frame; the open session is
        combined with *session*.
        """
        kind, is_stream = message.TYPE.name, message.TYPE in m.STREAM_RANGE
        due_us = self._ahead_us(at) + apart_us
        is_odd = any((number, flags, session, length))
        is_remembered = not (is_odd or is_stream or isinstance(message, m.UploadChunk))
        flags |= m.Flag.IMMEDIATE if at is None else 0

        def body(host: DialogueHost) -> bytes:
            render = host.stream if is_stream else host.request
            time_us = host.slot_us + due_us
            whole = render(message, number=number, flags=flags, time_us=time_us, other=session)
            if is_remembered:
                host.remember(whole)
            made = whole[: max(HEADER_BYTES, len(whole) + length)] + bytes(max(0, length))
            host.last = host.last if is_stream else made[:MAX_BODY_BYTES]
            return made[:MAX_BODY_BYTES]

        name = f"{kind} for {at}" if is_stream else kind
        return DialogueAction(0, name, body, ends_slot=at in _LATCHED_AS_IT_COMES)

    def defective(self, message: m.Message, *defects: str) -> DialogueAction:
        """Return a request with some of :data:`DEFECTS`."""
        merged = {key: value for defect in defects for key, value in DEFECTS[defect].items()}
        if isinstance(message, m.Mute):
            merged["length"] = max(0, merged.get("length", 0))
        if "session" in merged and self._pick((0, 1)):  # whose number is any
            merged["number"] = -self._across(1, 1 << 16)
        made = self.frame(message, self._pick((0.0, -2.0, 10_000.0)), **merged)
        return made._replace(name=f"{made.name} with {' and '.join(defects)}")

    def again(self, which: str, age: int) -> DialogueAction:
        """Return a request of the session open *age* ago once more; see DialogueHost.of_session."""
        name = f"the {which} request of the session {age} before once more"

        def body(host: DialogueHost) -> bytes:
            found = host.of_session(which, age)
            if found and which == "hello":
                host.go_on_in(m.Hello.deserialize(found[HEADER_BYTES:]).nonce)
            return found or host.request(m.Ping(1))

        return DialogueAction(0, name, body, ends_slot=True)

    def repeated(self) -> DialogueAction:
        """Return the last request of this nonce that the board has remembered, once more."""
        return self.again("last", 0)

    def hello(self, which: str) -> DialogueAction:
        """Return a HELLO with the open nonce, one of sessions before, a new one or none.

        Numbers of a session that is *wrapping* soon wrap, or pass the middle.
        """
        new, near = self._across(1, 0x10000), self._pick(WRONG_SESSIONS)
        first = self._pick(_FIRST_NUMBERS) - self._across(6)
        minor, back = self._pick((0, 0, 1, 0xFF)), self._pick((0, 0, 0, 1, 5, 0x4000))
        table = self._pick((0, self._across(2**32)))

        def body(host: DialogueHost) -> bytes:
            known = {"open": host.session, "0": 0, "near": (host.session ^ near) or 1}
            known["largest"] = 0xFFFF
            if host.sessions:
                known |= {"last": host.sessions[-1], "earlier": host.sessions[0]}
            nonce = known.get(which, new)
            takes = which not in ("0", "next major")
            if which == "wrapping":
                host.seq = first
            elif takes and nonce != host.session:
                host.seq -= back
            message = m.Hello(m.VERSION_MAJOR + (which == "next major"), minor, nonce, table)
            return host.hello(message, takes=takes)

        return DialogueAction(0, f"HELLO {which}", body)

    def _ahead_us(self, at: At) -> int:
        """Return how many µs from now a frame is due: below 0, in the past.

        *at* is a number of slots (40 ms); "late", "too late", "far", "beyond" (the horizon), or
        another text for a time at a limit; None for any time, as it counts for nothing.
        """
        horizon_us = self._identity.max_horizon_us
        if at is None:  # its time counts for nothing
            return self._pick((0, -3 * SLOT_US, 8 * SLOT_US, 1 << 31, self._across(1 << 32)))
        if isinstance(at, float):
            return round(at * SLOT_US)
        named = {
            "late": -SLOT_US // 4,
            "too late": -SLOT_US * 3 // 2,
            "beyond": 2 * horizon_us,
            "far": min(_FAR_US, horizon_us // 2),
        }
        return named[at] if at in named else self._limit_us()

    def _limit_us(self) -> int:
        """Return a random time ahead in µs at a limit, or 1 µs short of it.

        The limits are the horizon, the late window, and 2^31 µs.
        """
        horizon_us, lead_us = self._identity.max_horizon_us, self._identity.latch_lead_us
        windows = [lead_us - window_us for window_us in LATE_WINDOWS_US] * 3
        edge = self._pick((horizon_us + 1, *windows, 1, 2**31 - 1, -(2**31)))
        return edge + self._pick((0, -1))
