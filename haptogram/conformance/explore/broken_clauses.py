"""Clauses that a difference between board and model speaks of, by message, field and counter."""

from __future__ import annotations

from typing import Final

from haptogram_protocol import messages as m

from ..clauses import load_spec_table

#: A reply or an event that is due: the clause by which it is.
DUE_CLAUSES: Final[dict[type[m.Message], str]] = {
    m.HelloReply: "HG-4.3/1",
    m.ArmReply: "HG-6.2/1",
    m.MuteReply: "HG-6.4/1",
    m.DisarmReply: "HG-6.2/1",
    m.Pong: "HG-6.9/2",
    m.StatusReply: "HG-9.1/3",
    m.ConfigReply: "HG-7.1/3",
    m.SetConfigReply: "HG-7.1/3",
    m.GeometryReply: "HG-7.5/1",
    m.DriveReply: "HG-8.6/1",
    m.UploadBeginReply: "HG-7.2/1",
    m.UploadChunkReply: "HG-7.3/1",
    m.UploadCommitReply: "HG-7.4/2",
    m.PlayReply: "HG-7.6/1",
    m.StopReply: "HG-7.7/1",
    m.TraceReply: "HG-8.5/2",
    m.Status: "HG-9.1/1",
    m.Trace: "HG-8.1/1",
    m.TracePlayback: "HG-8.1/1",
    m.TraceDrive: "HG-8.4/1",
    m.StateChanged: "HG-6.8/1",
    m.PlaybackEnded: "HG-7.8/1",
}
_REFUSALS: Final = [
    (row["request"], m.ErrorCode[row["answer"].removeprefix("ERROR(")[:-1]], row["clause"])
    for row in load_spec_table("request")
]
#: A refusal that is due: by request and code, and by the code alone where no request has its own.
REFUSAL_CLAUSES: Final[dict[tuple[int, int], str]] = {
    (m.MessageType[name], code): clause for name, code, clause in _REFUSALS if name != "any"
}
LINK_REFUSAL_CLAUSES: Final[dict[int, str]] = {
    code: clause for name, code, clause in _REFUSALS if name == "any"
}
#: Counters: those of dropped frames first, as a frame that is not dropped moves others too.
COUNTER_CLAUSES: Final[dict[str, str]] = {
    "cobs": "HG-2.2/2",
    "crc": "HG-2.4/2",
    "short": "HG-2.5/1",
    "oversize": "HG-2.6/3",
    "unknown_type": "HG-3.3/2",
    "stale_session": "HG-3.7/2",
    "duplicate": "HG-5.5/1",
    "unsupported": "HG-3.4/1",
    "bad_length": "HG-3.2/4",
    "bad_value": "HG-3.2/5",
    "dropped_state": "HG-5.7/1",
    "dropped_order": "HG-5.7/2",
    "dropped_full": "HG-5.7/3",
    "dropped_future": "HG-5.7/4",
    "dropped_late": "HG-5.7/5",
    "repeated": "HG-4.9/1",
    "gap": "HG-5.5/2",
    "flushed": "HG-5.8/3",
    "late": "HG-5.7/6",
    "timeouts": "HG-6.11/5",
    "trace_dropped": "HG-8.7/2",
    "latched": "HG-5.8/4",
    "accepted": "HG-5.7/8",
    "requests": "HG-3.9/2",
    "frames": "HG-3.9/2",
}
#: Bytes of the board that are no frame, by the reason why they are none.
BROKEN_FRAME_CLAUSES: Final[dict[str, str]] = {
    "cobs": "HG-2.2/1",
    "crc": "HG-2.4/1",
    "short": "HG-3.1/1",
    "oversize": "HG-2.6/1",
    "unknown_type": "HG-11.5/2",
    "bad_length": "HG-3.2/3",
    "bad_value": "HG-3.2/5",
}
#: Fields of any message.
FIELD_CLAUSES: Final = {
    "state": "HG-6.2/1",
    "reason": "HG-6.2/3",
    "queued": "HG-5.7/8",
    "last_seq": "HG-3.6/5",
    "last_latch_us": "HG-8.3/3",
    "margins": "HG-9.3/1",
    "margin_min_us": "HG-9.3/1",
    "margin_mean_us": "HG-9.3/1",
    "config": "HG-7.1/3",
    "config_crc": "HG-7.1/5",
    "sound_speed_mm_s": "HG-7.1/3",
    "major": "HG-4.2/1",
    "minor": "HG-4.2/1",
    "crc": "HG-8.3/2",
    "index": "HG-3.6/5",
    "elements": "HG-7.5/3",
    "oldest": "HG-8.5/1",
    "next": "HG-8.5/1",
}
#: Fields of read-backs, and of a header, by their name there.
MESSAGE_FIELD_CLAUSES: Final[dict[tuple[type[m.Message], str], str]] = {
    (m.DriveReply, "key"): "HG-8.6/3",
    (m.DriveReply, "t_latch_us"): "HG-8.6/3",
    (m.DriveReply, "phase"): "HG-8.6/3",
    (m.DriveReply, "amplitude"): "HG-8.6/3",
    (m.StateChanged, "state"): "HG-6.11/5",
    (m.StateChanged, "reason"): "HG-12.5/1",
    (m.Trace, "flags"): "HG-5.7/6",
    (m.TracePlayback, "flags"): "HG-5.7/6",
    (m.TraceDrive, "flags"): "HG-5.7/6",
}
_TRACES: Final = (m.Trace, m.TracePlayback, m.TraceDrive)


def clause_of_due_message(due: m.Message) -> str:
    """Return the clause by which a board sends *due*, or refuses a request with it.

    Examples
    --------
    >>> clause_of_due_message(Error(request=0x4D, code=ErrorCode.BAD_VALUE, detail=0))
    'HG-7.6/2'
    """
    if isinstance(due, m.Error):
        if due.code == m.ErrorCode.UNSUPPORTED and due.detail == due.request:
            return "HG-3.3/3"
        of_link = LINK_REFUSAL_CLAUSES.get(due.code, "HG-10.2/1")
        return REFUSAL_CLAUSES.get((due.request, due.code), of_link)
    return DUE_CLAUSES.get(type(due), "HG-3.3/1")


def clause_of_message_field(due: m.Message, name: str) -> str:
    """Return the clause that says what the field *name* of *due* is.

    Examples
    --------
    >>> clause_of_message_field(Pong(0, 0, 0), "t_tx_us")
    'HG-6.9/2'
    """
    kind = type(due)
    return (
        MESSAGE_FIELD_CLAUSES.get((kind, name))
        or FIELD_CLAUSES.get(name)
        or clause_of_due_message(due)
    )


def clause_of_header_field(due: m.Message, name: str) -> str:
    """Return the clause that says what the field *name* of the header of *due* is.

    Examples
    --------
    >>> clause_of_header_field(Pong(0, 0, 0), "time_us")
    'HG-4.11/2'
    """
    is_response = due.TYPE in m.RESPONSE_RANGE
    if name == "flags":
        return MESSAGE_FIELD_CLAUSES.get((type(due), name), "HG-3.4/3")
    if name != "time_us":
        return "HG-4.11/1" if is_response else "HG-3.7/1"
    if isinstance(due, _TRACES):
        return "HG-8.3/1"
    return "HG-4.11/2" if is_response else "HG-12.1/1"
