"""The tests that the working tree touches: python ci/changed_tests.py [REVISION].

A changed module selects its mirrored folder of tests and every test file that imports it or a
module that imports it. Any other file selects the test files that name it.
"""

import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath

import grimp

PACKAGES = ("haptogram", "sim_device", "haptogram_protocol")
ALWAYS = "tests/test_architecture.py"
C_FOLDERS = {"protocol/c": "tests/protocol_c", "protocol/vectors": "tests/protocol_vectors"}


def changed_files(revision: str) -> list[str]:
    """Return the tracked files that differ from *revision*, and the untracked ones."""
    commands = (
        ["git", "diff", "--name-only", revision],
        ["git", "ls-files", "-o", "--exclude-standard"],
    )
    return [
        name
        for words in commands
        for name in subprocess.check_output(words, text=True).split("\n")
        if name
    ]


def module_of(file: str) -> str | None:
    """Return the dotted name of a file of the packages, None for any other."""
    parts = PurePosixPath(file.removeprefix("protocol/")).with_suffix("").parts
    if not file.endswith(".py") or parts[0] not in PACKAGES:
        return None
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def mirrored_folder(module: str) -> str:
    """Return the folder of tests for the room of *module*."""
    folder = Path("tests", *module.replace("haptogram_protocol", "protocol").split(".")[:-1])
    while not folder.is_dir():
        folder = folder.parent
    return str(folder)


def needles(file: str, graph: grimp.ImportGraph) -> Iterator[str]:
    """Yield patterns of text that a test of *file* holds."""
    module = module_of(file)
    if module is None:
        path = PurePosixPath(file)
        packages = [folder.name for folder in path.parents if Path(folder, "__init__.py").is_file()]
        name = [path.stem, *packages][-1]
        yield rf"\b(from|import) {name}\b" if path.suffix == ".py" else re.escape(path.name)
        return
    users = graph.find_modules_that_directly_import(module) if module in graph.modules else set()
    rooms = {name for name in users if graph.find_children(name)}  # an export selects nothing
    for name in (module, *(users - rooms)):
        package, _, last = name.rpartition(".")
        yield rf"{re.escape(name)}\b"
        yield rf"from {re.escape(package)} import (\([^)]*|[^\n(]*)\b{last}\b"


def touched_tests(files: Iterable[str]) -> list[str]:
    """Return the test files and folders to run for the changed *files*."""
    graph = grimp.build_graph(*PACKAGES)
    texts = {str(path): path.read_text("utf-8") for path in Path("tests").rglob("test_*.py")}
    selected = {ALWAYS}
    for file in files:
        if file in texts:
            selected.add(file)
            continue
        pattern = re.compile("|".join(needles(file, graph)))
        selected.update(test for test, text in texts.items() if pattern.search(text))
        selected.update(tests for folder, tests in C_FOLDERS.items() if file.startswith(folder))
        if (module := module_of(file)) and (folder := mirrored_folder(module)) != "tests":
            selected.add(folder)
    return sorted(selected)


if __name__ == "__main__":
    tests = touched_tests(changed_files(*(sys.argv[1:] or ["HEAD"])))
    sys.stdout.write("\n".join(tests) + "\n")
