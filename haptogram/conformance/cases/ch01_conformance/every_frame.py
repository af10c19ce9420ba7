"""HG-2.1, HG-2.2, HG-2.4, HG-2.6, HG-3.1, HG-3.2, HG-3.4, HG-3.6, HG-3.7, HG-3.9, HG-4.3, HG-4.11,
HG-5.8, HG-6.2, HG-7.1, HG-7.2, HG-7.5, HG-7.6, HG-8.3, HG-8.5, HG-8.6, HG-9.1, HG-9.2,
HG-11.5: what every frame of all other cases has shown.

These rules hold in each frame, whatever was asked.
"""

from __future__ import annotations

from typing import Final

from haptogram.records.frame import Evidence

from ...case import Case
from ...client.board_client import BoardClient
from ...outcome import SELF_REPORTED, WIRE, RuleFindings, check, require

_RULES: Final[dict[str, tuple[str, Evidence]]] = {
    "HG-2.1/1": ("no two frames share a delimiter", WIRE),
    "HG-2.2/1": ("each is the COBS encoding of its bytes, and nothing stands between two", WIRE),
    "HG-2.4/1": ("each has its CRC-32, if the line cannot damage it", WIRE),
    "HG-2.6/1": ("none is longer than 4096 bytes between its delimiters", WIRE),
    "HG-3.1/1": ("each is one of a board, and an event's time is near the responses'", WIRE),
    "HG-3.2/3": ("each payload has the length of its type", WIRE),
    "HG-3.4/3": ("none has a flag, but a trace LATE", WIRE),
    "HG-3.6/2": ("events of a session count up by 1 from 0", WIRE),
    "HG-3.7/1": ("each has the session that is open, ERROR(STALE_SESSION) none", WIRE),
    "HG-3.9/2": ("frames is the sum of its parts in each status", SELF_REPORTED),
    "HG-4.3/1": ("HELLO_REPLY names the same board each time", WIRE),
    "HG-4.11/1": ("each response answers one request, by its type and number", WIRE),
    "HG-4.11/3": ("each response to a request alone on the line begins within 10 ms", WIRE),
    "HG-4.11/5": ("of one moment STATE_CHANGED comes before PLAYBACK_ENDED", WIRE),
    "HG-5.8/3": ("no two latches are traced in one carrier period", SELF_REPORTED),
    "HG-6.2/3": ("the reason in a status suits its state", SELF_REPORTED),
    "HG-7.1/3": ("the configuration is the one that was set last", SELF_REPORTED),
    "HG-7.1/5": ("config_crc changes with SET_CONFIG and UPLOAD_COMMIT alone", SELF_REPORTED),
    "HG-7.2/6": ("UPLOAD_BEGIN_REPLY names the limits of HELLO_REPLY", WIRE),
    "HG-7.2/7": ("while the same sequences are stored an upload finds room as before", WIRE),
    "HG-7.5/1": ("the geometry is the same each time", WIRE),
    "HG-7.6/4": ("each traced latch of a playback has the codes that were stored", SELF_REPORTED),
    "HG-8.3/2": ("each traced latch of the stream has the codes that were sent", SELF_REPORTED),
    "HG-8.5/2": ("the ring tells numbers that it holds, in order", SELF_REPORTED),
    "HG-8.6/3": ("each read-back of the stream shows the codes that were sent", SELF_REPORTED),
    "HG-9.1/3": (
        "queue, margins and latches of a status fit together",
        SELF_REPORTED,
    ),
    "HG-9.2/1": ("no counter goes back", SELF_REPORTED),
    "HG-11.5/2": ("no type, value, error code or bit is outside the tables", WIRE),
}


def _standing_case(clause: str) -> Case:
    """Return the case that fails if any frame of the run broke the standing rule *clause*.

    The case is NOT-OBSERVED if no frame of the run was judged by that rule.
    """
    summary, evidence = _RULES[clause]

    def body(board: BoardClient) -> None:
        found = board.standing or RuleFindings()
        require(clause in found.judged, "no frame of this run tells of it")
        check(clause not in found.broken, found.broken.get(clause, ""))

    return Case(
        clause,
        f"in all frames of the run: {summary}",
        body,
        "always",
        evidence=evidence,
        needs_session=False,
        judges_all=True,
    )


PRODUCT: Final = tuple(_standing_case(clause) for clause in _RULES)
