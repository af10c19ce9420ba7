"""Boards that change something with a request that they refuse, or refuse it too often.

SPEC.md chapters 7 to 10.
"""
# ruff: noqa: SLF001 -- a mutant differs from the healthy board inside

from __future__ import annotations

import dataclasses
from typing import Any, Final

from haptogram.records.frame import Evidence
from haptogram_protocol.messages import (
    Config,
    ErrorCode,
    Message,
    SetConfig,
    UploadBegin,
    UploadCommit,
)
from sim_device.board.board import Board
from sim_device.board.refusal import RefusalError
from sim_device.board.uploads import BoardUploads, Upload
from sim_device.dialects.haptogram import VirtualHaptogramDialect
from sim_device.mutants import Mutant


class RefusedPlayFlushes(Board):
    """Flushes its queue for a PLAY that it refuses."""

    def play(self, sequence: int, **more: Any) -> None:
        """Flush the queue and then play."""
        self.output.counters.flushed += self._queue.flush()
        super().play(sequence, **more)


class RefusedConfigSetsTrace(VirtualHaptogramDialect):
    """Takes the trace fields of a configuration that it refuses."""

    def _set_config(self, message: SetConfig, request: Any) -> Message:
        wanted, output = message.config, self.board.output
        output.config = dataclasses.replace(
            output.config, trace_mode=wanted.trace_mode, trace_divider=max(1, wanted.trace_divider)
        )
        return super()._set_config(message, request)


class RefusedConfigRestartsStatus(VirtualHaptogramDialect):
    """Starts the status period anew with a configuration that it refuses."""

    def _set_config(self, message: SetConfig, request: Any) -> Message:
        self._schedule_status()
        return super()._set_config(message, request)


class RefusedUploadRestartsStatus(VirtualHaptogramDialect):
    """Starts the status period anew with an upload that it refuses."""

    def _reply_to(self, message: Message, request: Any) -> Message:
        try:
            return super()._reply_to(message, request)
        except RefusalError:
            if isinstance(message, UploadBegin):
                self._schedule_status()
            raise


class RefusedConfigRenewsHold(Board):
    """Starts the hold anew with a configuration that it refuses."""

    def configure(self, config: Config) -> None:
        """Configure, or start the hold anew."""
        try:
            super().configure(config)
        except RefusalError:
            if self.output._sounding:
                self.output._timers.latched(self.output.now_us, self.output.config)
            raise


class RefusedPlayRenewsHold(Board):
    """Starts the hold anew with a PLAY that it refuses."""

    def play(self, sequence: int, **more: Any) -> None:
        """Play, or start the hold anew."""
        try:
            super().play(sequence, **more)
        except RefusalError:
            if self.output._sounding:
                self.output._timers.latched(self.output.now_us, self.output.config)
            raise


class RefusedPlayIsUnattended(Board):
    """Lets the unattended time of a PLAY that it refuses stand for ``host_timeout_ms``."""

    def play(self, sequence: int, **more: Any) -> None:
        """Give the lease its length, and then play."""
        self.output.unattended_ms = more["unattended_ms"]
        super().play(sequence, **more)


class RefusedBeginAbandons(BoardUploads):
    """Abandons the upload under way for an UPLOAD_BEGIN that it refuses."""

    def begin(self, begin: UploadBegin, room: int) -> None:
        """Begin anew, and forget what was there."""
        self.abandon()
        super().begin(begin, room)


class MismatchAbandons(BoardUploads):
    """Abandons an upload whose commit it refuses with CRC_MISMATCH."""

    def commit(self) -> Upload:
        """Commit, or forget it."""
        try:
            return super().commit()
        except RefusalError as error:
            if error.code is ErrorCode.CRC_MISMATCH:
                self.abandon()
            raise


class NoUploadWhilePlaying(Board):
    """Refuses every upload while any sequence plays."""

    def _refuse_while_playing(self, sequence: int) -> None:
        playing = sequence if self._playback is None else self._playback.sequence
        super()._refuse_while_playing(playing)


class CommitIntoPlaying(Board):
    """Looks only in UPLOAD_BEGIN whether the sequence plays, and not in UPLOAD_COMMIT."""

    def commit_upload(self, commit: UploadCommit) -> int:
        """Commit, and play on with the frames of the upload."""
        playing, self._playback = self._playback, None
        try:
            return super().commit_upload(commit)
        finally:
            if playing is not None and commit.target == playing.sequence:
                playing.frames = self._sequences[commit.target]
            self._playback = playing


_WIRE, _SELF, *_ = Evidence

MUTANTS: Final = (
    Mutant.of(RefusedPlayFlushes, "HG-10.1/1", _SELF),
    Mutant.of(RefusedConfigSetsTrace, "HG-10.1/1", _SELF),
    Mutant.of(RefusedConfigRestartsStatus, "HG-9.1/1", _WIRE),
    Mutant.of(RefusedUploadRestartsStatus, "HG-9.1/1", _WIRE),
    Mutant.of(RefusedConfigRenewsHold, "HG-6.10/1", _WIRE),
    Mutant.of(RefusedPlayRenewsHold, "HG-6.10/1", _WIRE),
    Mutant.of(RefusedPlayIsUnattended, "HG-10.1/1", _WIRE),
    Mutant.of(RefusedBeginAbandons, "HG-10.1/1", _WIRE),
    Mutant.of(MismatchAbandons, "HG-10.1/1", _WIRE),
    Mutant.of(NoUploadWhilePlaying, "HG-7.2/5", _WIRE),
    Mutant.of(CommitIntoPlaying, "HG-7.2/5", _WIRE),
)
