from __future__ import annotations

import base64
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from haptogram.acoustics import AcousticModel
from haptogram.errors import ConfigurationError
from haptogram.machine.provenance import UNSTATED
from haptogram.report.formats.html import write_document_page
from haptogram.report.run.document import run_document
from haptogram.verification import RunVerdict
from judged_runs import damage, delay, hurry, lose, make_result, make_run, targets

VOID = {"meta", "img", "br", "input"}


class Outline(HTMLParser):
    """Reads a page, checks that its elements nest, and keeps texts and pictures."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[str] = []
        self.texts: list[str] = []
        self.pictures: list[bytes] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        given = dict(attrs)
        assert not {"onclick", "onload", "onerror"} & set(given)
        if tag == "img":
            assert given["alt"]
            source = given["src"] or ""
            assert source.startswith("data:image/svg+xml;base64,")
            self.pictures.append(base64.b64decode(source.partition(",")[2], validate=True))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def write_page(path: Path, run: RunVerdict, model: AcousticModel, **changes: Any) -> None:
    write_document_page(path, run_document(run, make_result(run, **changes), model), UNSTATED)


def written(path: Path, run: RunVerdict, model: AcousticModel, **changes: Any) -> Outline:
    write_page(path / "report.html", run, model, **changes)
    outline = Outline()
    outline.feed((path / "report.html").read_text(encoding="utf-8"))
    outline.close()
    assert outline.open == []
    assert not {"link", "iframe", "object"} & set(outline.tags)
    # That of the tables; the view, and its scene.
    assert outline.tags.count("script") == (3 if run.frames else 1)
    return outline


def test_a_page_holds_everything_in_itself(
    tmp_path: Path, good_run: RunVerdict, model: AcousticModel
) -> None:
    outline = written(tmp_path, good_run, model)
    assert outline.pictures == []  # the view draws them
    assert "shock lengths from the array" in " ".join(outline.texts)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=\"(?!data:|#)", page)
    assert "http" not in re.sub(r"base64,[^\"]*", "", page)


def test_the_same_run_gives_the_same_page(
    tmp_path: Path, good_run: RunVerdict, model: AcousticModel
) -> None:
    pages = []
    for _ in range(2):
        written(tmp_path, good_run, model)
        pages.append((tmp_path / "report.html").read_bytes())
    assert pages[0] == pages[1]


def test_without_the_extra_no_page_is_begun(
    tmp_path: Path, good_run: RunVerdict, model: AcousticModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "jinja2", None)
    advice = r"^HTML pages need jinja2: pip install .*\[report\]'$"
    with pytest.raises(ConfigurationError, match=advice):
        write_page(tmp_path / "a.html", good_run, model)
    assert not (tmp_path / "a.html").exists()


def test_what_others_named_is_escaped(
    tmp_path: Path, good_run: RunVerdict, model: AcousticModel
) -> None:
    hostile = "/dev/<script>alert(1)</script>\"'&\udc80"
    outline = written(
        tmp_path,
        good_run,
        model,
        configuration={"port": hostile, hostile: 1},
        board={"label": hostile},
        warnings=[hostile],
        environment={"machine": hostile},
    )
    shown = hostile.replace("\udc80", "?")
    assert outline.texts.count(shown) == 5


def test_lost_and_late_frames_are_named_with_what_that_did(
    tmp_path: Path, model: AcousticModel
) -> None:
    run = make_run(model, targets(6), {2: lose, 4: delay})
    texts = written(tmp_path, run, model).texts
    assert "400 µs late" in texts
    assert (
        "1 lost by the board, 0 held up by this machine and 1 late; each is named below." in texts
    )
    effects = [text for text in texts if re.fullmatch(r"the focus .* mm away.* Pa .* Pa", text)]
    assert len(effects) == 2


def test_a_wrong_frame_is_named_with_its_fault(tmp_path: Path, model: AcousticModel) -> None:
    run = make_run(model, targets(4), {1: damage, 2: hurry})
    page = " | ".join(written(tmp_path, run, model).texts)
    assert run.sentence in page
    assert "elements 3 (0, 3), 4 (0, 4), 5 (0, 5) dead" in page
    assert "50 µs early" in page


def test_what_was_not_seen_is_said(tmp_path: Path, model: AcousticModel) -> None:
    run = make_run(model, targets(3), dict.fromkeys(range(3), lose))
    page = " | ".join(written(tmp_path, run, model).texts)
    assert run.sentence in page
    assert "None: no latch of the board was observed." in page
    assert "3 frames of 3 could not be verified at all." in page
    assert "No frame could be judged." in page


def test_frames_with_the_same_thing_wrong_are_one_row(tmp_path: Path, model: AcousticModel) -> None:
    run = make_run(model, targets(120), {**dict.fromkeys(range(118), lose), 119: damage})
    page = " ".join(written(tmp_path, run, model).texts)
    assert page.count("lost frame") <= 1
    assert re.search(r"and 117 like it: \d+, (\d+, ){7}\.\.\.", page)


def test_a_page_that_cannot_be_written_is_named(
    tmp_path: Path, good_run: RunVerdict, model: AcousticModel
) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match=r"file/report\.html"):
        write_page(tmp_path / "file" / "report.html", good_run, model)
