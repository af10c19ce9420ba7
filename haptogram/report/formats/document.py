"""A result as a document, which terminal, page, JUnit XML and job summary show alike."""

from __future__ import annotations

import base64
import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final, TypeAlias

#: Tone of a page by its verdict, or by that of a point of a sweep.
TONES: Final = {"pass": "good", "fail": "bad", "error": "bad", "inconclusive": "doubt"}


class Outcome(enum.StrEnum):
    """Outcome of a check, in words."""

    PASSED = "passed"
    FAILED = "failed"
    INCONCLUSIVE = "inconclusive"
    NOT_JUDGED = "not judged"  # nothing was seen that could have answered it
    NOTED = "noted"  # found, but decides nothing


@dataclass(frozen=True, slots=True)
class Check:
    """One check and its outcome: a case for JUnit XML.

    Attributes
    ----------
    group : str
        Name of its group.
    name : str
        The sentence that is true if the check passed, or its number.
    outcome : Outcome
        How it ended.
    message : str
        The finding in one line.
    details : sequence of str
        Lines that the finding concerns.
    kind : str
        Kind of the finding, by default the name of the group.
    log : str
        Further output, empty for none.
    seconds : float or None
        How long it took; None: it took no time of its own.
    """

    group: str
    name: str
    outcome: Outcome
    message: str
    details: Sequence[str] = ()
    kind: str = ""
    log: str = ""
    seconds: float | None = None

    @property
    def decisive(self) -> bool:
        """True if the outcome decides the verdict."""
        return self.outcome in (Outcome.FAILED, Outcome.INCONCLUSIVE)


class Level(enum.StrEnum):
    """Weight of a finding; the value is the command of GitHub for it."""

    ERROR = "error"
    WARNING = "warning"
    NOTICE = "notice"


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding.

    Attributes
    ----------
    level : Level
        An error decides the verdict, a warning does not.
    name : str
        Name of the case, the check or the kind of event.
    text : str
        The finding in one line.
    """

    level: Level
    name: str
    text: str


@dataclass(frozen=True, slots=True)
class Table:
    """A table: the names of its columns, the texts of its rows, and the kinds of columns.

    Attributes
    ----------
    head : sequence of str
        Names of the columns; empty: none has a name.
    rows : sequence of sequences of str
        The cells, the first of a row its name.
    numbers, texts : sequence of int
        Columns of numbers and of long texts; 0 is the first.
    """

    kind: ClassVar = "table"
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    numbers: Sequence[int] = ()
    texts: Sequence[int] = ()


@dataclass(frozen=True, slots=True)
class Listing:
    """Sentences, one below the other."""

    kind: ClassVar = "listing"
    items: Sequence[str]


@dataclass(frozen=True, slots=True)
class PagePicture:
    """A picture for a page.

    Attributes
    ----------
    svg : bytes
        The picture.
    title : str
        Subject of the picture; read aloud in its place.
    caption : str
        Explanation below the picture.
    """

    svg: bytes
    title: str
    caption: str = ""

    @property
    def source(self) -> str:
        """The picture as the address of an image."""
        return f"data:image/svg+xml;base64,{base64.b64encode(self.svg).decode('ascii')}"


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture, drawn when a page is written: text needs no matplotlib."""

    kind: ClassVar = "picture"
    draw: Callable[[], PagePicture]


@dataclass(frozen=True, slots=True)
class View:
    """The interactive view of a scene, as ``ViewerScene.embedded`` returns it, and a note on it."""

    kind: ClassVar = "view"
    scene: str
    note: str


Block: TypeAlias = Table | Listing | Picture | View


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a document; a page can fold one that few readers need."""

    title: str
    blocks: Sequence[Block]
    folds: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Document:
    """A result, what matters most first.

    Attributes
    ----------
    command : str
        Name of the command.
    heading : str
        The verdict and its reason.
    title : str
        Title of the page.
    tone : str
        "good", "bad", "doubt" or "plain".
    findings : sequence of Finding
        Findings, the likeliest cause first.
    lead : sequence of str
        Further sentences, without a full stop.
    sections : sequence of Section
        Figures and pictures.
    checks : sequence of Check
        Checks with their outcomes.
    properties : mapping of str to str
        Properties of the run, for JUnit XML.
    seconds : float or None
        How long it took; None: not stated.
    template : str
        Template of the page.
    content : callable
        Makes what this template alone shows, when a page is written.
    """

    command: str
    heading: str
    title: str = ""
    tone: str = "plain"
    findings: Sequence[Finding] = ()
    lead: Sequence[str] = ()
    sections: Sequence[Section] = ()
    checks: Sequence[Check] = ()
    properties: Mapping[str, str] = field(default_factory=dict)
    seconds: float | None = None
    template: str = "document.html"
    content: Callable[[], Mapping[str, Any]] = dict
