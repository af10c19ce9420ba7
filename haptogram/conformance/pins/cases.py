"""The cases that a capture of the drive pins adds to a run of the suite."""

from __future__ import annotations

import dataclasses
from typing import Final

from ..case import Case, unobservable_case
from ..outcome import EXTERNAL

#: Word after the clause in the id of these cases.
VARIANT: Final = "pins"
_SUMMARIES: Final = {
    "HG-5.2/1": "from the latch of a PHASES frame on, each pin has the phase of its code",
    "HG-5.3/1": "from the latch of a DRIVES frame on, each pin has its phase and amplitude",
    "HG-5.4/1": "from the latch of focal points on, each pin has the drive that they lead to",
    "HG-5.8/1": "the pins take a drive in the first carrier period from its t_apply on",
    "HG-5.8/2": "in a latch all pins change within one carrier period",
    "HG-5.8/5": "no pin falls silent between a latch and the next one, or the end of the output",
    "HG-6.3/1": "after ARM the pins are silent until the first frame, or PLAY, arrives",
    "HG-6.6/1": "the pins are silent a period after MUTE, DISARM, a new session or a fault",
    "HG-6.6/2": "no pin has a pulse while the board says DISARMED, MUTED or FAULT",
    "HG-6.10/1": "the pins are silent once the board says that the hold ended the output",
    "HG-6.11/1": "in a ramp no pin gets louder than its line",
    "HG-6.11/2": "in a ramp the amplitude at the pins follows the straight line to 0",
    "HG-6.11/6": "what is set in a ramp leaves its line; the ceiling in force cuts it off",
    "HG-6.12/2": "from a reset until the first latch after ARM the pins are silent",
    "HG-7.6/4": "in a playback each frame of the sequence is at the pins, and when it is due",
    "HG-7.9/1": "the phases at the pins are those of the drive and the correction",
    "HG-7.9/2": "no amplitude at the pins is above the ceiling, and those below it are as sent",
    "HG-8.3/1": "the pins change at the time that the trace of the latch tells",
    "HG-12.1/1": "the pins are silent once the board says that a playback was left unattended",
    "HG-12.2/1": "the pins are silent once the board says that the lease ended the output",
}
#: A case by clause; none of them sends anything.
PIN_CASES: Final[dict[str, Case]] = {
    clause: dataclasses.replace(unobservable_case(clause, summary, EXTERNAL), variant=VARIANT)
    for clause, summary in _SUMMARIES.items()
}
