"""The log of a board: a line for each change of the output, and few of them where they are many."""

from __future__ import annotations

import pytest

from haptogram_protocol.state import MuteReason, OutputState
from sim_device.board.events import PowerDown, Remark, StateChange
from sim_device.log import BoardNoticeLog


def logged(caplog: pytest.LogCaptureFixture, *, is_complete: bool) -> list[str]:
    """Return the lines of 500 changes in half a second, a fault, a remark, a change, the end."""
    log = BoardNoticeLog(is_complete=is_complete)
    with caplog.at_level("INFO", "sim_device.log"):
        for number in range(500):
            t_us = 7_000_000 + 1000 * number
            log.notice(StateChange(t_us, OutputState.ARMED, MuteReason.NONE, requested=True))
        log.notice(StateChange(7_500_000, OutputState.FAULT, MuteReason.FAULT, requested=False))
        log.notice(Remark(7_500_000, "another wire"))
        log.notice(StateChange(8_500_000, OutputState.MUTED, MuteReason.MUTE, True))
        log.notice(PowerDown(8_500_000))
    return [record.getMessage() for record in caplog.records]


def test_many_changes_are_counted(caplog: pytest.LogCaptureFixture) -> None:
    assert logged(caplog, is_complete=False) == [
        *(f"armed, at {7_000_000 + 1000 * number} us" for number in range(20)),
        "480 changes before this one are left out; -v logs all",
        "fault: fault, at 7500000 us",
        "another wire, at 7500000 us",
        "muted: mute, at 8500000 us",
        "told to end, at 8500000 us",
    ]


def test_a_complete_log_leaves_no_change_out(caplog: pytest.LogCaptureFixture) -> None:
    assert len(logged(caplog, is_complete=True)) == 504
