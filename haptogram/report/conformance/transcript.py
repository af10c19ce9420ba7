"""The bytes of a case for a reader: the frames that decide are marked, the rest is short."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from haptogram.conformance.verdict import CaseResult

_HEAD: Final = re.compile(r"^(\s*[+-][\d.]+ s) (host|board) ?")
_WORDS: Final = re.compile(r"0x[0-9a-f]+|\d{4,}|[A-Z]{3,}(?:_[A-Z]+)*|[a-z]+(?:_[a-z]+)+")
_SEQ: Final = re.compile(r"\w+ seq (\d+) ")
#: Parts of a finding that are no deed of the board: what is due, what is missing, what came before.
_NOT_DONE: Final = re.compile(
    r"; (?:sent (?:before|between): .*?(?= \((?:meanwhile|in its)|$)|dialogue \d+.*)"
    r"|should [^;]*; |(?:[A-Z_]+: )?no [A-Z_]+ within [^;]*|\bdue (?:is|are) [^;,:]*",
    re.DOTALL,
)
_READINGS: Final = ("PING", "GET_STATUS", "GET_CONFIG", "READ_DRIVE", "READ_TRACE")
_ZEROS: Final = re.compile(r"\b\w+=0(?:, |(?=\)))")  # counters that say nothing
_MOST: Final = 9  # frames of a folded transcript
_WIDTH: Final = 110  # columns of a frame that decides nothing


class _Frame(NamedTuple):
    """A frame of a transcript: its lines, its sender and what it says."""

    lines: range
    head: str
    sender: str
    text: str

    @property
    def name(self) -> str:
        """Type of the frame."""
        return self.text.partition(" ")[0]


def marked_transcript(result: CaseResult) -> list[str]:
    """Return the whole transcript; lines of the frames that decide begin with ``>``."""
    deciding = {line for frame in _deciding_frames(result) for line in frame.lines}
    lines = enumerate(result.transcript)
    return [f"{'>' if number in deciding else ' '} {line}" for number, line in lines]


def folded_transcript(result: CaseResult) -> Iterator[str]:
    """Yield the frames that decide, marked and with their bytes, and those near them in short."""
    frames, deciding = _frames_of(result.transcript), _deciding_frames(result)
    if not frames:
        yield from result.transcript[-_MOST:]
        return
    last = max(frames.index(frame) for frame in deciding)
    near = sorted(frames, key=lambda frame: abs(last - frames.index(frame)))[:_MOST]
    shown = [place for place, frame in enumerate(frames) if frame in near or frame in deciding]
    before = shown[0] - 1
    for place in shown:
        if place != before + 1:
            yield f"  ... {place - before - 1} frames"
        before, frame = place, frames[place]
        text = f"{frame.head} {frame.sender:<5} {frame.text}"
        if frame not in deciding:
            yield f"  {text if len(text) <= _WIDTH else text[: _WIDTH - 4] + ' ...'}"
            continue
        yield f"> {_ZEROS.sub('', text)}"
        rows = [result.transcript[line] for line in frame.lines][:-1]
        yield from (f"  {row}" for row in rows[:1])
    if len(shown) < len(frames):
        yield f"  all {len(frames)} frames, and their bytes, are in --json and --html"


def _deciding_frames(result: CaseResult) -> list[_Frame]:
    """Return the frame of the board that the finding speaks of, what it answers, and its cause."""
    frames = _frames_of(result.transcript)
    done = _NOT_DONE.sub("", result.detail)
    told = {"STATUS_REPLY"} if "counted " in done else set(_WORDS.findall(done))

    def place(frame: _Frame) -> tuple[int, int]:
        words = set(_WORDS.findall(frame.text))
        alike = sum(1 if word.islower() else 3 for word in words & told)
        is_named = bool(told & {frame.name, frame.name.removesuffix("_REPLY")})
        return alike + 4 * is_named, frame.lines.start

    board = [frame for frame in frames if frame.sender == "board"]
    host = [frame for frame in frames if frame.sender == "host"]
    causes = [frame for frame in host if frame.name not in _READINGS] or host
    found = [max(some, key=place) for some in (board, causes) if some]
    found += _asked(board and found[0], host)
    return sorted(set(found), key=lambda frame: frame.lines.start)


def _asked(answer: _Frame | list[_Frame], host: Sequence[_Frame]) -> list[_Frame]:
    """Return the request that a frame of the board answers."""
    seq = _SEQ.match(answer.text) if isinstance(answer, _Frame) else None
    if seq is None or not isinstance(answer, _Frame):
        return []
    before = [
        frame
        for frame in host
        if frame.lines.start < answer.lines.start and f" seq {seq[1]} " in frame.text
    ]
    return before[-1:]


def _frames_of(transcript: Sequence[str]) -> list[_Frame]:
    found: list[_Frame] = []
    start, head, sender = 0, "", ""
    for number, line in enumerate(transcript):
        if match := _HEAD.match(line):
            start, head, sender = number, match[1].strip(), match[2]
        if (text := line.strip()).startswith("= "):
            span = range(start, number + 1)
            found.append(_Frame(span, head, sender, text.removeprefix("= ")))
            start = number + 1
    return found
