"""The published table of faults: rows made anew are those of the page."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
LENGTHS = ("across mm", "along mm", "away mm")  # of other processors in the last digit


def _generator() -> ModuleType:
    path = ROOT / "ci" / "fault_table.py"
    spec = importlib.util.spec_from_file_location("fault_table", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look themselves up there
    spec.loader.exec_module(module)
    return module


TABLE = _generator()


def _published() -> dict[str, list[str]]:
    text = (ROOT / "docs" / "consequences.md").read_text(encoding="utf-8")
    lines = [
        line for line in text.splitlines() if line.startswith("| `") or line.startswith("| none |")
    ]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    (harmless,) = re.findall(rf"{TABLE.HARMLESS}(.*)\.\n", text)
    return {row[0]: row for row in rows} | {
        name: [name, *rows[0][1:]] for name in harmless.split(", ")
    }


def test_every_fault_is_on_the_page() -> None:
    assert _published().keys() == {f"`{plan}`" if plan else "none" for plan in TABLE.plans()}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["line.drop", "line.slice", "device.stuck"])
def test_a_row_made_anew_is_the_published_one(name: str) -> None:
    (fault,) = (plan for plan in TABLE.plans() if plan.startswith(f"{name} "))
    made, published = TABLE.row(fault).cells, _published()[f"`{fault}`"]
    for column, new, old in zip(TABLE.COLUMNS, made, published, strict=True):
        if new == old:
            continue
        if column in LENGTHS:
            assert float(new) == pytest.approx(float(old), abs=0.02), column
        elif column == "Pa":
            figures = ([int(word) for word in cell.split(" of ")] for cell in (new, old))
            assert next(figures) == pytest.approx(next(figures), abs=2)
        else:
            pytest.fail(f"{column}: {new}, on the page {old}")
