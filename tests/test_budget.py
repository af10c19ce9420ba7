"""Each room has a budget of code lines: tests/budget.toml.  A commit that raises one says why."""

import ast
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PRODUCT = ("haptogram", "sim_device", "protocol/haptogram_protocol")
HAS_DOCSTRING = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
HOLDS_DEFINITIONS = ast.stmt | ast.excepthandler | ast.match_case


def code_lines(text):
    """Return the number of lines that are neither blank nor comment nor docstring."""
    texts = (line.strip() for line in text.splitlines())
    lines = {number for number, line in enumerate(texts, 1) if line and not line.startswith("#")}
    for node in statements(ast.parse(text)):
        if isinstance(node, HAS_DOCSTRING) and ast.get_docstring(node, clean=False) is not None:
            lines.difference_update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return len(lines)


def statements(node):
    """Yield *node* and every statement in it, at any depth."""
    yield node
    for child in ast.iter_child_nodes(node):
        if isinstance(child, HOLDS_DEFINITIONS):
            yield from statements(child)


def room_of(path, rooms):
    """Return the innermost room in which a file is; None: it is in none."""
    folders = (str(folder) for folder in path.relative_to(ROOT).parents)
    return next((folder for folder in folders if folder in rooms), None)


def test_code_lines_are_counted_without_comments_and_docstrings():
    lines = ('"""Docstring', 'of two lines."""', "", "# comment", "def f():", '    """Doc."""')
    code = ("    return (", "        1", "    )")
    text = "\n".join([*lines, *code, ""])
    assert code_lines(text) == 4


def test_every_room_keeps_its_budget_of_code_lines():
    rooms = tomllib.loads((ROOT / "tests" / "budget.toml").read_text("utf-8"))["code-lines"]
    counts = dict.fromkeys(rooms, 0)
    for package in PRODUCT:
        for path in sorted((ROOT / package).rglob("*.py")):
            room = room_of(path, rooms)
            assert room is not None, f"{path.relative_to(ROOT)}: its room has no budget"
            counts[room] += code_lines(path.read_text("utf-8"))
    over = {room: (count, rooms[room]) for room, count in counts.items() if count > rooms[room]}
    assert over == {}, "rooms with their code lines and budget: make them smaller, or say why not"
    slack = {room: rooms[room] - count for room, count in counts.items()}
    loose = {room: left for room, left in slack.items() if left > max(50, rooms[room] // 10)}
    assert loose == {}, "rooms with the code lines that they no longer need: lower their budget"
