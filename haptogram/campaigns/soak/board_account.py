"""The account at the board: each verdict of the board against the bytes that came to it."""

from __future__ import annotations

from haptogram_protocol.messages import FIRST_STREAM_SEQ, Hello, Mute

from .account.tally import UNEXPLAINED, SoakTally
from .board import BoardUnderSoak
from .line import Sent, SoakLine, sent_soak_message_type
from .oracle import SoakOracle


class SoakBoardAccount:
    """Compares the verdicts of a board with the line to it.

    Parameters
    ----------
    board : Board
        Its clock and its session are read.
    line : SoakLine
        To the board.
    oracle : SoakOracle
        Takes the frames that the board must latch.
    tally : SoakTally
        The account.
    """

    def __init__(
        self, board: BoardUnderSoak, line: SoakLine, oracle: SoakOracle, tally: SoakTally
    ) -> None:
        self._board, self._line, self._oracle, self._tally = board, line, oracle, tally
        self._last_taken = b""
        self._expected_index = FIRST_STREAM_SEQ

    def begin_session(self) -> None:
        """Expect the first stream frame of a session."""
        self._expected_index = FIRST_STREAM_SEQ  # HG-3.6/5

    def judge(self, verdict: int | str, t_ns: int) -> bool:
        """Compare a verdict of the board with what came; return whether it switches the output off.

        A frame that came whole is taken; a copy of it is known; everything else is damage.
        """
        sent = self._line.next_sent(verdict, "the board")
        if sent is None:
            return False
        self._tally.totals["board frames"] += 1
        if sent.session == self._board.session:
            self._oracle.heard(self._board.device_us(t_ns))
        if sent.hit is not None:
            sent.hit.delivered = True
        if sent.kind == "stream":
            self._judge_stream(sent, verdict, t_ns)
            return False
        return self._judge_request(sent, verdict)

    def _judge_stream(self, sent: Sent, verdict: int | str, t_ns: int) -> None:
        if isinstance(verdict, int) and verdict < self._expected_index:
            self._tally.violate("copy taken", f"frame {verdict} once more")
        elif isinstance(verdict, int):
            missing = verdict - self._expected_index
            self._explain_gap(missing)
            self._expected_index = verdict + 1
            rx_us = self._board.device_us(t_ns)
            self._oracle.came(sent.session, verdict, sent.about, rx_us, sent.cause)
        elif verdict == "duplicate" and sent.hit is not None:
            self._tally.find(sent.hit, verdict)
            self._tally.totals["duplicate"] += 1
        else:
            self._tally.violate("undamaged frame dropped", f"a stream frame, as {verdict}")

    def _explain_gap(self, missing: int) -> None:
        self._tally.totals["gap"] += missing
        if missing > len(self._line.lost):
            lost = len(self._line.lost)
            self._tally.violate(UNEXPLAINED, f"{missing} frames never came, {lost} were lost")
            self._line.lost.clear()
        for _ in range(min(missing, len(self._line.lost))):
            self._tally.find(self._line.lost.popleft(), "gap")

    def _judge_request(self, sent: Sent, verdict: int | str) -> bool:
        copy = sent.encoded == self._last_taken
        kind = sent_soak_message_type(sent.encoded)
        wanted = "repeated" if copy and kind != Mute.TYPE else "request"
        self._last_taken = sent.encoded
        if verdict != wanted:
            self._tally.violate("undamaged frame dropped", f"{wanted}, as {verdict}")
        self._tally.totals[str(verdict)] += 1
        if copy and sent.hit is not None and sent.hit.kind.endswith("duplicate"):
            self._tally.find(sent.hit, str(wanted))
        return kind in (Hello.TYPE, Mute.TYPE) and not copy
