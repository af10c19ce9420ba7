"""Pages: self-contained, escaped, and refused before any work where the extra is missing."""

import re
import sys
from importlib.resources import files

import pytest

from haptogram.cli import main
from haptogram.errors import ConfigurationError, missing_extra
from haptogram.machine.provenance import UNSTATED
from haptogram.report.formats.document import PagePicture
from haptogram.report.formats.html import check_html_page, render_html_page

FRAME = {"title": "t", "heading": "h", "tone": "plain", "lead": []}
PAGES = [
    template.name
    for template in (files("haptogram.report") / "templates").iterdir()
    if template.name.endswith(".html") and template.name not in {"base.html", "parts.html"}
]


def comparison(**changes):
    content = {"names": ["a"], "rows": [], "totals": [], "tone_of": lambda _: "plain"}
    return render_html_page("comparison.html", UNSTATED, **FRAME, **(content | changes))


@pytest.mark.parametrize("name", PAGES)
def test_every_page_extends_the_one_base_and_has_no_style_of_its_own(name):
    text = (files("haptogram.report") / "templates" / name).read_text()
    assert text.startswith('{% extends "base.html" %}')
    assert not re.search(r"<style|style=|<table|<script|https?:", text)


def test_a_name_is_escaped_wherever_it_stands():
    hostile = "<script>\"'&"
    page = comparison(totals=[(hostile, hostile)], names=[hostile])
    assert "<script>" not in page
    assert page.count("&lt;script&gt;&#34;&#39;&amp;") == 3


def test_a_value_that_is_missing_is_an_error_and_no_gap():
    from jinja2 import UndefinedError

    with pytest.raises(UndefinedError, match="totals"):
        render_html_page("comparison.html", UNSTATED, **FRAME, names=[], rows=[], tone_of=None)


def test_a_picture_is_part_of_the_page():
    assert PagePicture(b"svg", "").source == "data:image/svg+xml;base64,c3Zn"


def test_dark_and_light_and_print_are_one_style_sheet():
    page = comparison()
    assert page.count("<style>") == 1
    assert "@media screen and (prefers-color-scheme: dark)" in page
    assert "@media print" in page


@pytest.mark.parametrize(
    ("arguments", "package"),
    [
        (["verify", "--virtual-time", "--html", "a.html"], "jinja2"),
        (["conform", "--html", "a.html"], "jinja2"),
        (["conform", "--compare", "a.json", "--html", "a.html"], "jinja2"),
        (["bench", "--html", "a.html"], "jinja2"),
        (["bench", "--html", "a.html"], "matplotlib"),
        (["bench", "--picture", "a.png"], "matplotlib"),
        (["field", "--picture", "a.png"], "matplotlib"),
    ],
    ids=lambda value: value if isinstance(value, str) else " ".join(value),
)
def test_without_the_extra_a_command_refuses_before_it_works(
    monkeypatch, tmp_path, capsys, arguments, package
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, package, None)
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"haptogram {arguments[0]}: ")
    assert err.endswith(f"{missing_extra(f' need {package}', 'report')}\n")
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_page_without_pictures_needs_no_matplotlib(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    check_html_page()
    with pytest.raises(ConfigurationError, match="matplotlib"):
        check_html_page(pictures=True)


def test_what_stands_between_backticks_is_code_and_still_escaped():
    from haptogram.report.formats.html import _html_code_spans

    assert _html_code_spans("count it in `<crc>`.") == "count it in <code>&lt;crc&gt;</code>."
