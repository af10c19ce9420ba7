"""Subjects of what a board of another dialect says about its client."""

from __future__ import annotations

import enum


class About(enum.StrEnum):
    """Subject of a remark."""

    CLIENT = "client"
    OTHER_WIRE = "other wire"  # its bytes are those of another dialect
    OTHER_ARRAY = "other array"  # frame after frame is one of another array
    OTHER_SIZE = "other size"  # a frame has another size than those of the board
    OTHER_RATE = "other rate"  # its line has a baud rate that the real boards do not have
    NO_COMMIT = "no commit"  # frames follow each other, and nothing shows them
    STOPPED = "stopped"  # the client fell silent in a frame, or left before it was shown


#: Subjects that leave a client undecided: what the board shows of it is not what it means.
UNDECIDED = (About.OTHER_WIRE, About.OTHER_RATE)
