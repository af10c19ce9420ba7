"""The package as a whole: standard library only, nothing happens on import, public names."""

import ast
import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import haptogram_protocol

FOLDER = Path(haptogram_protocol.__file__).parent
MODULES = [
    name
    for _, name, _ in pkgutil.walk_packages([str(FOLDER)], prefix="haptogram_protocol.")
    if not name.endswith("__main__")
]
# What reads a clock, does I/O or starts a thread has no place here; the exports write files.
PURE = {
    "__future__",
    "collections",
    "dataclasses",
    "enum",
    "functools",
    "math",
    "operator",
    "re",
    "struct",
    "types",
    "typing",
    "zlib",
}
OPTIONAL = {
    "cobs.py": {"cobs"},  # COBS in C, taken where it is installed
    "dialects/table.py": {"importlib", "pathlib", "pkgutil"},  # finds the modules of the package
}
# From two rooms further down an import of ours is written in full; random is seeded.
EXPORT = PURE | {
    "argparse",
    "haptogram_protocol",
    "json",
    "pathlib",
    "random",
    "sys",
    "textwrap",
}


def _imported(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add((node.module or "").split(".")[0])
    return found


def _is_export(path: Path) -> bool:
    return path.relative_to(FOLDER).parts[0].startswith("export")


@pytest.mark.parametrize(
    "path", sorted(FOLDER.rglob("*.py")), ids=lambda path: str(path.relative_to(FOLDER))
)
def test_only_the_pure_part_of_the_standard_library_is_imported(path: Path) -> None:
    allowed = EXPORT if _is_export(path) else PURE
    assert _imported(path) <= allowed | OPTIONAL.get(str(path.relative_to(FOLDER)), set())


def test_it_imports_alone_and_silently() -> None:
    code = f"import {', '.join(MODULES)}, sys; print(sorted(sys.modules.keys() & {{'numpy'}}))"
    done = subprocess.run(
        [
            sys.executable,
            "-I",
            "-c",
            f"import sys; sys.path.insert(0, {str(FOLDER.parent)!r}); {code}",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert (done.stdout, done.stderr) == ("[]\n", "")


@pytest.mark.parametrize("name", ["haptogram_protocol", *MODULES])
def test_every_public_name_exists_and_is_listed_once(name: str) -> None:
    module = importlib.import_module(name)
    listed = getattr(module, "__all__", [])
    assert len(set(listed)) == len(listed)
    assert all(hasattr(module, public) for public in listed)


def test_every_message_is_a_public_name_of_messages() -> None:
    from haptogram_protocol import messages

    assert {kind.__name__ for kind in messages.MESSAGES.values()} <= set(dir(messages))
    assert {member.value for member in messages.MessageType} == set(messages.MESSAGES)


def test_dir_lists_the_public_names_and_nothing_else() -> None:
    assert dir(haptogram_protocol) == sorted(haptogram_protocol.__all__)
    undocumented = [
        name
        for name in haptogram_protocol.__all__
        if callable(getattr(haptogram_protocol, name))
        and not getattr(haptogram_protocol, name).__doc__
    ]
    assert undocumented == []
