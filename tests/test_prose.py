"""The prose of public docstrings: a subject and a verb, not a clause of "what" as a noun."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("haptogram", "sim_device", "protocol/haptogram_protocol")
DEFINITIONS = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
CLAUSE = re.compile(
    r"^(What|How|Where|Whether|Whoever)\b|^(Tell|Say|Return|Yield) (what|how|where|whether)\b"
)


def docstrings(node, name):
    """Yield name and docstring of *node* and of every public definition in it."""
    yield name, ast.get_docstring(node) or ""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, DEFINITIONS) and not re.match(r"_(?!_)", child.name):
            yield from docstrings(child, f"{name}.{child.name}")


def clauses(source, name):
    return [f"{n}: {doc.splitlines()[0]}" for n, doc in docstrings(ast.parse(source), name)
            if CLAUSE.match(doc)]  # fmt: skip


@pytest.mark.parametrize("package", PACKAGES)
def test_no_public_docstring_begins_with_a_clause(package):
    modules = sorted((ROOT / package).rglob("*.py"))
    assert modules
    assert [
        clause
        for path in modules
        for clause in clauses(path.read_text("utf-8"), str(path.relative_to(ROOT)))
    ] == []


@pytest.mark.parametrize(
    "doc",
    ["What it is.", "Where it lies.", "Tell whether it runs.", "Return how often.", "Whether."],
)
def test_a_clause_is_found_in_modules_classes_and_methods(doc):
    source = f'"""{doc}"""\nclass A:\n    """{doc}"""\n    def b(self):\n        """{doc}"""\n'
    assert [found.split(":")[0] for found in clauses(source, "m")] == ["m", "m.A", "m.A.b"]
    assert clauses(f'def _private():\n    """{doc}"""\n', "m") == []
    assert clauses('def f():\n    """Return the number of times, whatever happens."""\n', "m") == []
