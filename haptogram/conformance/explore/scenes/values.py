"""Scenes of byte values: frames with one byte that has any value."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import Feature, Header, Hello, Message, Mute, SetConfig, Stop

from ..host import DialogueHost
from ..makers.makers import DialogueMakers
from ..makers.stream import MadeAction
from ..tables.byte_values import byte_values
from .inputs import SceneInputs
from .told import Told, ToldSlots, told_as_made

_HELLO: Final = "HELLO"
_CONFIG: Final = "SET_CONFIG"
_SLOTS: Final = 3
_FRAMES: Final = {True: 24, False: 5}  # in a slot, where bytes take no time, and where they do
_BYTES: Final = 8000  # of a slot, at most


class ByteValueScenes:
    """Makes scenes of byte values.

    Parameters
    ----------
    makers : DialogueMakers
        Makers of the frames.
    inputs : SceneInputs
        Makes every request.
    """

    def __init__(self, makers: DialogueMakers, inputs: SceneInputs) -> None:
        self._conditions, self._makers, self._inputs = makers.conditions, makers, inputs
        most = _BYTES // (64 + 2 * self._conditions.identity.transducers)
        self._frames = max(1, min(_FRAMES[self._conditions.exact], most))

    def scene(self) -> ToldSlots:
        """Return slots of frames with one byte that has any value, and a probe behind each."""
        found: ToldSlots = []
        requests, source = self._makers.requests, self._conditions.random
        for _ in range(_SLOTS):
            which = source.choice(("short", "short", "long"))
            found.append([self._told(which) for _ in range(self._frames)])
            found.append(told_as_made([requests.plain(Stop()), *requests.probe()]))
        return found

    def _told(self, which: str) -> Told:
        name, offset, value = self._conditions.next(
            f"{which} fields", lambda: self._values()[which]
        )
        # A MUTE has a write of its own: it may overtake what is sent with it.
        is_mute = int(offset) == Header.WIRE["type"].offset and int(value) == Mute.TYPE
        return Told(self._with_byte(name, int(offset), int(value)), wait_us=int(is_mute))

    def _values(self) -> dict[str, list[tuple[str, str, str]]]:
        requests = {name: type(make()) for name, make in self._inputs.messages().items()}
        requests[_HELLO] = Hello
        if self._conditions.can & Feature.CONFIG:
            requests[_CONFIG] = SetConfig
        stream = {name: type(make()) for name, make in self._makers.stream.kinds.items()}
        return byte_values(requests, stream)

    def _with_byte(self, name: str, offset: int, value: int) -> MadeAction:
        """Return the frame called *name* with one byte of its body changed."""
        kind, text, body = self._frame(name)

        def changed(host: DialogueHost) -> bytes:
            whole = bytearray(body(host))
            whole[offset] = value
            return bytes(whole)

        return f"{kind} with a byte", f"{text}, byte {offset} of the body is {value:#04x}", changed

    def _frame(self, name: str) -> MadeAction:
        stream, requests = self._makers.stream, self._makers.requests
        if name in stream.kinds:
            return stream.of(0.5, stream.kinds[name]())
        if name == _HELLO:
            return self._makers.sessions.hello("open")
        message: Message
        if name == _CONFIG:
            message = SetConfig(self._makers.configs.last)
        else:
            message = self._inputs.messages()[name]()
        return requests.plain(message)
