"""The second verdict: requests and stream work again after a case."""

from __future__ import annotations

from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.state import OutputState

from ..client.board_client import BoardClient
from ..client.introduction import introduce_to_board
from ..client.recording import counter_steps, moved_counters_text
from ..outcome import CaseEndedError
from ..verdict import Recovery

_LOOKS: Final = 1000  # most reads of the status while the board computes other frames
_TARGET: Final = 1  # a sequence that many cases store
MAX_FRAMES: Final = 3  # requests; the board has to answer one of them


def recover_board(board: BoardClient) -> Recovery:
    """Send requests until one is answered, then a stream frame; return the verdict.

    A session is opened first if the case left none.
    """
    board.wire.begin_case()
    board.clock.forget_exchange()
    try:
        for number in range(1, MAX_FRAMES + 1):
            if _answers_after_recovery(board):
                return Recovery(number, _stream_fault_at_recovery(board))
    except CaseEndedError as error:  # a flood
        return Recovery(None, str(error))
    return Recovery(None)


def farewell_after_recovery(board: BoardClient) -> None:
    """Mute the board at the end of a run."""
    board.wire.begin_case()
    board.link.ask(m.Mute())


def _answers_after_recovery(board: BoardClient) -> bool:
    """Return True if the board answers a PING of the session that the case left.

    A refusal counts too, if the board then answers a HELLO of a new session.
    """
    seq = board.link.next_seq()
    wire, _ = board.link.request_wire(m.Ping(board.random.getrandbits(64)), seq=seq)
    since = board.link.mark()
    board.link.send(wire)
    answer = board.link.await_answer(seq, since)
    if answer is not None and isinstance(answer.message, m.Pong):
        return True
    # A board refuses a PING without a session or of an old one: HELLO decides.
    return answer is not None and isinstance(introduce_to_board(board), m.HelloReply)


def _stream_fault_at_recovery(board: BoardClient) -> str:
    """Open a session, arm the board and send a stream frame; return what went wrong as text.

    '' if exactly one frame was latched.
    """
    reply = introduce_to_board(board)
    if not isinstance(reply, m.HelloReply):
        return "HELLO is not answered"
    try:
        if reply.state is OutputState.FAULT:  # the case ended in it
            board.leaves_fault()
        if board.has(m.Feature.CONFIG) and hasattr(board, "config"):
            # Timers of the case may end before a frame is ready.
            answer = board.link.ask(m.SetConfig(board.base_config)).message
            if isinstance(answer, m.SetConfigReply):
                board.config = answer.config
        board.link.ask(m.Arm())
        before = board.link.ask(m.GetStatus()).message
        board.link.send(board.link.stream_wire(board.flat_phases()))
        board.clock.wait_latched(0)
        after = board.link.ask(m.GetStatus()).message
        for _ in range(min(_LOOKS, board.identity.queue_depth)):
            if not isinstance(after, m.StatusReply) or not after.queued:
                break
            board.wire.idle(board.clock.lead_us)  # it still computes those of the case
            after = board.link.ask(m.GetStatus()).message
        board.link.ask(m.Disarm())
        _ask_for_room(board)
        if isinstance(before, m.StatusReply) and isinstance(after, m.StatusReply):
            if counter_steps(before.counters, after.counters)["latched"] == 1:
                return ""
            moved = moved_counters_text(before.counters, after.counters)
            return (
                "HELLO, SET_CONFIG, ARM and a stream frame are to latch it; "
                f"{after.state.name}, {after.reason.name}, queued {after.queued}, counted {moved}"
            )
    except CaseEndedError as error:
        return f"in a new session: {error}"
    return "GET_STATUS in a new session is not answered by STATUS_REPLY"


def _ask_for_room(board: BoardClient) -> None:
    """Begin the largest uploads to learn the free memory; a standing rule judges the replies.

    A board without that much memory reports its free memory in the refusal of the first; the second
    is accepted, and abandoned.
    """
    count, most = board.identity.transducers, board.identity.max_sequence_frames
    frames = board.identity.max_upload_bytes // count
    for number in sorted({frames, min(frames, most)}, reverse=True):
        if board.has(m.Feature.SEQUENCE_PHASES) and number:
            board.link.ask(m.UploadBegin(m.UploadKind.PHASES, 0, _TARGET, number * count, 0))
