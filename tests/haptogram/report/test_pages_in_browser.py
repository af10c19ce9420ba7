"""The pages in a real browser: they sort, are searched, unfold, and fit a narrow screen."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from haptogram.acoustics import AcousticModel
from haptogram.cli import main
from haptogram.machine.provenance import UNSTATED
from haptogram.report.formats.html import write_document_page
from haptogram.report.run.document import run_document
from haptogram.report.viewer.server import ViewServer
from judged_runs import aim, delay, lose, make_result, make_run, targets

WRONG = "haptogram://?clock=virtual&array=4x4&mutant=crc-unchecked"
_WIDTHS = (1280, 400)


@pytest.fixture(scope="module")
def conform_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("conform") / "page.html"
    clauses = ("--clause", "HG-2", "--clause", "HG-11")
    assert main(["conform", "--quiet", "--port", WRONG, *clauses, "--html", str(path)]) == 1
    return path


@pytest.fixture(scope="module")
def run_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    model, points = AcousticModel.default(8, 8), targets(30)
    run = make_run(model, points, {2: lose, 4: delay, 20: aim(model, points[20] + 2e-3)})
    path = tmp_path_factory.mktemp("verify") / "page.html"
    write_document_page(path, run_document(run, make_result(run), model), UNSTATED)
    return path


OpenPage = Callable[..., Any]


def test_the_focus_is_seen_without_scrolling(open_page: OpenPage, tmp_path: Path) -> None:
    model = AcousticModel.default(8, 8)
    run = make_run(model, targets(3), {1: lose})
    write_document_page(tmp_path / "a.html", run_document(run, make_result(run), model), UNSTATED)
    page = open_page((tmp_path / "a.html").as_uri(), ready="body")
    page.set_viewport_size({"width": 1280, "height": 720})
    top = "() => document.querySelector('.stage').getBoundingClientRect().top"
    assert page.evaluate(top) < 360
    page.set_viewport_size({"width": 390, "height": 600})
    page.wait_for_function("document.documentElement.scrollWidth <= 390")  # the view is drawn anew
    assert page.evaluate(top) < 600


def first_cells(page: Any, table: str) -> list[str]:
    script = """(table) => [...document.querySelectorAll(`${table} > tbody > tr`)]
      .filter((row) => !row.hidden).map((row) => row.cells[0].textContent.trim())"""
    found: list[str] = page.evaluate(script, table)
    return found


def cases_table(page: Any) -> str:
    """Unfold and mark the table of the cases of chapter 2, and return its selector."""
    page.evaluate("location.hash = 'HG-2.1/1'")
    page.wait_for_function("document.getElementById('HG-2.1/1').closest('details').open")
    page.evaluate("document.getElementById('HG-2.1/1').closest('table').id = 'cases'")
    return "#cases"


def test_a_table_sorts_by_keyboard_and_comes_back_to_its_order(
    open_page: OpenPage, conform_page: Path
) -> None:
    page = open_page(conform_page.as_uri(), ready="body")
    table = cases_table(page)
    before = first_cells(page, table)
    head = page.locator(f"{table} thead th").nth(1)
    orders = []
    head.locator("button").focus()
    for state in ("ascending", "descending", None):
        page.keyboard.press("Enter")
        assert head.get_attribute("aria-sort") == state
        orders.append(first_cells(page, table))
    failed = page.locator(f"{table} > tbody > tr:has(.badge:text-is('FAILED')) > :first-child")
    first = orders[0][: failed.count()]
    assert set(first) == {text.strip() for text in failed.all_inner_texts()}
    assert first == orders[1][-len(first) :]  # those with one verdict keep their order
    assert orders[2] == before
    page.locator(f"{table} thead th button").first.press("Enter")
    assert first_cells(page, table) == before


def test_a_table_is_searched_by_words_but_not_in_the_bytes(
    open_page: OpenPage, conform_page: Path
) -> None:
    page = open_page(conform_page.as_uri(), ready="body")
    table = cases_table(page)
    search = page.locator(f".search:has(~ details {table})")
    every = len(first_cells(page, table))
    search.locator("input").fill("failed crc")
    shown = first_cells(page, table)
    assert "HG-2.4/2" in shown
    assert len(shown) < every / 4
    # One field searches every chapter; chapter 11, where nothing is found, vanishes.
    folds = page.locator("section > details:has(th[id^='HG-'])")
    assert [fold.is_visible() for fold in folds.all()] == [True, False]
    assert search.locator("output").inner_text().startswith(f"{len(shown)} of ")
    search.locator("input").fill("11.2/1")
    assert [fold.get_attribute("open") for fold in folds.all()] == [None, ""]
    search.locator("input").fill("PONG(")  # is in the bytes of the failures only
    assert first_cells(page, table) == []
    # A link to a row shows it, though the search had left it out.
    page.evaluate("location.hash = 'HG-2.1/2'")
    page.wait_for_function("!document.getElementById('HG-2.1/2').closest('tr').hidden")


def test_a_case_leads_to_its_clause_and_the_clause_to_its_cases(
    open_page: OpenPage, conform_page: Path
) -> None:
    page = open_page(conform_page.as_uri(), ready="body")
    clause = page.locator("[id='spec-HG-2.4/2']")
    assert not clause.is_visible()
    assert page.evaluate("document.documentElement.scrollHeight") < 4000  # chapters are folded
    page.locator("section a[href='#HG-2.4/2']").click()
    page.locator("[id='HG-2.4/2'] a").click()
    clause.wait_for(state="visible")
    chips = clause.locator("xpath=..").locator(".chips a")
    assert chips.first.get_attribute("href") == "#HG-2.4/2"
    broken = page.evaluate(
        """() => [...document.querySelectorAll('a[href^="#"]')]
             .map((link) => decodeURIComponent(link.hash.slice(1)))
             .filter((id) => !document.getElementById(id))"""
    )
    assert broken == []


def test_a_frame_of_the_table_is_shown_in_the_view(open_page: OpenPage, run_page: Path) -> None:
    page = open_page(run_page.as_uri())
    page.locator("#frame-20 a").click()
    status = "document.querySelector('[data-part=frame]').textContent"
    page.wait_for_function(f"{status}.includes('off target')")
    again = open_page(f"{run_page.as_uri()}#view-4")
    again.wait_for_function(f"{status}.includes('late')")


@pytest.mark.parametrize("width", _WIDTHS)
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("kind", ["conform_page", "run_page"])
def test_a_page_fits_the_screen(
    open_page: OpenPage, request: pytest.FixtureRequest, kind: str, scheme: str, width: int
) -> None:
    page = open_page(
        request.getfixturevalue(kind).as_uri(),
        ready="body",
        viewport={"width": width, "height": 800},
        color_scheme=scheme,
    )
    page.evaluate("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_the_tables_work_under_the_policy_of_the_server(
    open_page: OpenPage, run_page: Path
) -> None:
    server = ViewServer(run_page.read_text("utf-8"))
    try:
        page = open_page(server.address)
        page.locator("thead button").first.press("Enter")
        assert page.locator("[aria-sort=ascending]").count() == 1
    finally:
        server.close()
