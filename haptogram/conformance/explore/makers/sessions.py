"""HELLO of a random host: with every nonce, and with numbers that soon wrap."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.framing import HEADER_BYTES
from haptogram_protocol.messages import VERSION_MAJOR, Hello, Ping

from ..host import DialogueHost
from .conditions import DialogueMaker
from .stream import WRONG_SESSIONS, MadeAction

_MOST_U16: Final = 0xFFFF
_FIRST_NUMBERS: Final = (0xFFFF, 0x7FFF, 0xFF, 0x100FE)


class RandomSessions(DialogueMaker):
    """Makes HELLO, and requests of sessions before."""

    def greeting(self) -> MadeAction:
        """Return a HELLO of a new session, whose numbers soon wrap, or pass the middle."""
        across, pick = self._random.randrange, self._random.choice
        nonce, seq = across(1, 0x10000), pick(_FIRST_NUMBERS) - across(6)
        hello = Hello(VERSION_MAJOR, 0, nonce)

        def body(host: DialogueHost) -> bytes:
            host.seq = seq
            return host.hello(hello)

        return "HELLO new", f"HELLO with the number {seq + 1:#x}", body

    def again(self, which: str, age: int) -> MadeAction:
        """Return a request of the session open *age* ago once more; see DialogueHost.of_session."""
        text = f"the {which} request of the session {age} before once more"
        ping = Ping(1)

        def body(host: DialogueHost) -> bytes:
            found = host.of_session(which, age)
            if found and which == "hello":
                host.go_on_in(Hello.deserialize(found[HEADER_BYTES:]).nonce)
            return found or host.request(ping)

        return text, text, body

    def hello(self, which: str = "") -> MadeAction:
        """Return a HELLO: with the open nonce, one of sessions before, a new one or none."""
        across, pick = self._random.randrange, self._random.choice
        whiches = (
            "open",
            "open",
            "last",
            "last",
            "earlier",
            "new",
            "new",
            "near",
            "near",
            "largest",
        )
        which = which or pick((*whiches, "0", "next major"))
        new, near = across(1, 0x10000), pick(WRONG_SESSIONS)
        table = pick((0, across(2**32)))
        minor, back = pick((0, 0, 1, 0xFF)), pick((0, 0, 0, 1, 5, 0x4000))

        def body(host: DialogueHost) -> bytes:
            known = {"open": host.session, "0": 0, "near": (host.session ^ near) or 1}
            known["largest"] = _MOST_U16
            if host.sessions:
                known |= {"last": host.sessions[-1], "earlier": host.sessions[0]}
            nonce = known.get(which, new)
            message = Hello(VERSION_MAJOR + (which == "next major"), minor, nonce, table)
            takes = which not in ("0", "next major")
            is_new = takes and nonce != host.session
            return host.hello(message, takes=takes, back=back if is_new else 0)

        return f"HELLO {which}", f"HELLO, nonce: {which}, minor {minor}, {back} back", body
