"""The connection to the board under test: opened, reset, revived, closed with the output off."""

from __future__ import annotations

import contextlib
import dataclasses
import random
import time
from typing import Final

from haptogram.driver.line.port import Transport
from haptogram.errors import HaptogramError, LinkError, LinkLostError
from haptogram_protocol import messages as m

from ..case import Depth
from ..client.board_client import BoardClient
from ..client.introduction import (
    board_rate_at_introduction,
    describe_introduced_board,
    explain_silent_board,
    introduce_to_board,
    is_introduced_version_error,
    learn_clock_wraps_at_introduction,
)
from ..client.wire import ClientWaitLimits, RawFrameClient
from ..judge.recovery import farewell_after_recovery
from ..judge.standing_rules import StandingRules
from ..outcome import CaseEndedError, RuleFindings
from .access import Access

_GREETINGS: Final = 3  # the text that a board prints while it starts may drown the first HELLO


class SuiteConnection:
    """The board behind *access*, and why it is lost once it is.

    Parameters
    ----------
    access : Access
        Way to the board.
    timeout_s : float
        How long an answer may take.
    seed : int
        Seed of nonces and contents.
    depth : Depth
        How thoroughly cases judge.
    explore_s : float
        How long random dialogues go on; 0: a fixed number of them.

    Attributes
    ----------
    lost : str
        Why no session can be opened; empty while the board answers.
    device : dict
        Description of the board that answered last; empty before any did.
    baudrate : int
        Rate of the line: as stated, or as measured if that is less.
    rules : StandingRules
        Judges every frame that comes.
    nonces : set of int
        Nonces of the sessions that were opened, or asked for.
    """

    def __init__(
        self, access: Access, *, timeout_s: float, seed: int, depth: Depth, explore_s: float = 0
    ) -> None:
        self.lost = ""
        self.device: dict[str, object] = {}
        self.baudrate = access.baudrate
        self.nonces: set[int] = set()
        self._access, self._depth = access, depth
        self._explore_us = round(explore_s * 1e6)
        self._limits = self._usual = ClientWaitLimits.of(timeout_s, virtual=access.virtual)
        self._random = random.Random(seed)
        self._transport: Transport | None = None
        self._spent_us = self._connected_us = 0  # of boards before, and when this one came
        self._board: BoardClient | None = None
        self._findings = RuleFindings()
        self.rules = StandingRules(self._findings, is_lossless=access.virtual)

    def extend_lead(self, factor: int) -> None:
        """Send frames *factor* times as long before their t_apply as usual."""
        lead_us = factor * self._usual.lead_us
        self._limits = dataclasses.replace(self._usual, lead_us=lead_us)
        if self._board is not None:
            self._board.wire.limits = self._limits

    @property
    def board(self) -> BoardClient:
        """Client of the board; :class:`LinkError` before :meth:`open`."""
        if self._board is None:
            raise LinkError("the port is not open")
        return self._board

    @property
    def elapsed_us(self) -> int:
        """Time that has passed: in virtual time of all boards together, else of the host."""
        if not self._access.virtual:
            return time.monotonic_ns() // 1000
        if self._transport is None:
            return self._spent_us
        return self._spent_us + self.board.wire.now_us() - self._connected_us

    @property
    def until_wrap_us(self) -> int:
        """Time until the clock of a board that was just reset passes 2^32 µs; else negative."""
        clock = self.board.clock
        return (1 << 32) - clock.device_estimate_us() if clock.booted and not self.lost else -1

    def open(self) -> None:
        """Open the port and find out which board answers.

        Raises
        ------
        HaptogramError
            If the port does not open.  A board that does not answer is no error: see ``lost``.
        """
        try:
            self._connect(self._access.open(), booted=self._access.boots)
        except BaseException:
            self._access.close()
            raise
        if not self._answers() and self._access.can_reset and not self._access.boots:
            self.revive()  # the board may have hung before the run
        if not self.lost:
            with contextlib.suppress(CaseEndedError, LinkLostError):
                if not self._access.virtual:
                    self.baudrate = self.board.wire.baudrate = board_rate_at_introduction(
                        self.board
                    )
                learn_clock_wraps_at_introduction(self.board)

    def close(self) -> None:
        """Mute the board, and close the port."""
        if self._transport is not None and not self.lost:
            try:
                farewell_after_recovery(self.board)
            except HaptogramError:
                pass
            except Exception as error:  # the results must not be lost
                self.lost = f"the board was not muted at the end: {type(error).__name__}: {error}"
        self._drop()
        self._access.close()

    def session(self) -> BoardClient:
        """Return the client in a new session, with the board DISARMED and quiet.

        Raises
        ------
        LinkError
            If there is no board.
        """
        if self.lost:
            raise LinkError(self.lost)
        self.board.wire.begin_case()
        self.board.prepare()
        return self.board

    def reset(self) -> BoardClient:
        """Restart the board, and return the client of the board that has just started."""
        before = self._board
        self._drop()
        board = self._connect(self._access.reset(), booted=True)
        identity = getattr(before, "identity", None)
        board.last_boot_id = identity.boot_id if identity else None
        board.last_config = getattr(before, "config", None)
        board.dialogue = before.dialogue if before else None
        board.link.expect_boot(self._access.boot_timeout_s)
        return board

    def revive(self, *, may_reset: bool = True) -> None:
        """Try once to bring back a board that does not answer: reset it, or reopen the port."""
        why = self.lost
        try:
            if may_reset and self._access.can_reset:
                self.reset()
            else:
                self._drop()
                self._connect(self._access.open(), booted=False)
        except HaptogramError as error:
            self.lost = f"{why} ({error})"
            return
        if not self._answers():
            self.lost = why

    def _connect(self, transport: Transport, *, booted: bool) -> BoardClient:
        """Open a client on a transport; *booted*: the board starts anew with it."""
        wire = RawFrameClient(transport, self._limits, baudrate=self.baudrate)
        self._connected_us = wire.now_us()
        self._board, self._transport = BoardClient(wire, self._random, booted=booted), transport
        self._board.nonces = self.nonces
        self._board.thorough = self._depth > Depth.QUICK
        self._board.exhaustive = self._depth > Depth.DEFAULT
        self._board.standing, wire.on_piece = self._findings, self.rules.take
        wire.on_sent = self.rules.take_sent
        self.rules.begin_board(wire.line_us)
        self._board.explore_us = self._explore_us
        self._board.raise_fault = self._access.raise_fault
        self._board.restart = self.reset if self._access.can_reset else None
        return self._board

    def _drop(self) -> None:
        """Close the transport, if one is open; keep the time that has passed until then."""
        if self._transport is not None:
            self._spent_us = self.elapsed_us
            self.board.wire.close()
        self._transport = None

    def _answers(self) -> bool:
        """Return True if a board of this version answers one of 3 HELLOs; else note why not."""
        self.lost = ""
        if self.board.clock.booted:
            self.board.link.expect_boot(self._access.boot_timeout_s)
        try:
            for _ in range(_GREETINGS):
                reply = introduce_to_board(self.board)
                if isinstance(reply, m.HelloReply):
                    self.device = describe_introduced_board(reply)
                    return True
                if is_introduced_version_error(reply):
                    self.lost = f"the board speaks another major version: {reply}"
                    return False
            self.lost = explain_silent_board(self.board)
        except (LinkError, CaseEndedError) as error:
            self.lost = f"the board is gone: {error}" if self.device else str(error)
            self.lost = "; ".join(filter(None, (self.lost, self._access.last_words())))
        return False
