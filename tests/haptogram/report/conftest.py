"""A real browser, where there is one."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from typing import Any

import pytest

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """A headless browser; skipped where there is none (`ci/browser` installs one)."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright: ci/browser")
    path = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if path is None:
        pytest.skip("needs Chromium: ci/browser")
    with playwright.sync_playwright() as started:
        # Root, as in a container, has no sandbox; what is opened here are our own pages.
        running = started.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield running
        running.close()


@pytest.fixture
def open_page(browser: Any) -> Iterator[Callable[..., Any]]:
    """Opens a page, with a view by default; at the end none may have complained in its console."""
    complaints: list[str] = []
    opened = []

    def _open(address: str, ready: str = "#viewer[data-ready]", **settings: Any) -> Any:
        context = browser.new_context(**({"viewport": {"width": 1280, "height": 900}} | settings))
        page = context.new_page()
        page.on("console", lambda m: complaints.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(address)
        page.wait_for_selector(ready, state="attached")
        opened.append(context)
        return page

    yield _open
    for context in opened:
        context.close()
    assert not complaints
