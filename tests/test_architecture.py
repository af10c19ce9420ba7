"""The rules of the house that no single module can keep: imports, errors, exports, packaging."""

import ast
import importlib
import inspect
import os
import pkgutil
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import venv
from pathlib import Path
from zipfile import ZipFile

import pytest

from haptogram.errors import HaptogramError
from haptogram_protocol.errors import ProtocolError

ROOT = Path(__file__).resolve().parent.parent
SOURCES = {
    "haptogram": ROOT / "haptogram",
    "haptogram_protocol": ROOT / "protocol" / "haptogram_protocol",
    "sim_device": ROOT / "sim_device",
}
SPEC = ROOT / "protocol" / "SPEC.md"
ERROR_ROOTS = {
    "haptogram": (HaptogramError,),
    "haptogram_protocol": (ProtocolError,),
    "sim_device": (HaptogramError, ProtocolError),
}
CONTRACTS = {
    contract["id"]: contract["name"]
    for contract in tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
        "contracts"
    ]
}

# For each import contract a line that breaks it, and no other: file -> line.
PLANTS = [
    ("protocol-pure", {"protocol/haptogram_protocol/framing.py": "import time"}),
    ("protocol-pure", {"protocol/haptogram_protocol/framing.py": "import numpy"}),
    ("protocol-layers", {"protocol/haptogram_protocol/errors.py": "from . import messages"}),
    ("host-layers", {"haptogram/objects/mesh.py": "import haptogram.driver"}),
    ("host-without-simulator", {"haptogram/driver/driver.py": "import sim_device"}),
    ("acoustics-pure", {"haptogram/acoustics/model/geometry.py": "import socket"}),
    ("acoustics-pure", {"haptogram/acoustics/model/medium.py": "import haptogram_protocol"}),
    ("acoustics-pure", {"haptogram/acoustics/memory.py": "import haptogram.machine.waiter"}),
    (
        "acoustics-layers",
        {"haptogram/acoustics/levels/force.py": "import haptogram.acoustics.reconstruct.cells"},
    ),
    ("driver-layers", {"haptogram/driver/line/budget.py": "from haptogram.driver import playback"}),
    (
        "verification-layers",
        {"haptogram/verification/tolerance.py": "import haptogram.verification.faults"},
    ),
    ("conformance-layers", {"haptogram/conformance/clauses.py": "from . import verdict"}),
    ("settings-light", {"haptogram/settings/arguments.py": "import numpy"}),
    ("settings-light", {"haptogram/settings/arguments.py": "import time"}),
    ("records-light", {"haptogram/records/kept.py": "import numpy"}),
    ("records-light", {"haptogram/records/frame.py": "import time"}),
    (
        "no-circles",
        {
            "haptogram/verification/frame/peaks.py": "from . import circle",
            "haptogram/verification/frame/circle.py": "from . import peaks",
        },
    ),
    ("simulator-takes-physics", {"sim_device/board/board.py": "from haptogram import driver"}),
    (
        "simulator-takes-physics",
        {
            "haptogram/acoustics/solvers/several.py": "",
            "sim_device/board/board.py": "import haptogram.acoustics.solvers.several",
        },
    ),
    (
        "simulator-layers",
        {"sim_device/simulation.py": "", "sim_device/line/uart.py": "import sim_device.simulation"},
    ),
    ("simulator-clock", {"sim_device/board/board.py": "import time"}),
    ("board-knows-no-bytes", {"sim_device/board/board.py": "import haptogram_protocol.framing"}),
]


def modules(package):
    """Import *package* and everything in it but ``__main__``; yield the modules."""
    root = importlib.import_module(package)
    yield root
    for info in pkgutil.walk_packages(root.__path__, f"{package}."):
        if not info.name.endswith("__main__"):
            yield importlib.import_module(info.name)


@pytest.fixture
def tree(tmp_path):
    """Copy what a wheel is built from."""
    copy = tmp_path / "tree"
    for source in SOURCES.values():
        shutil.copytree(
            source, copy / source.relative_to(ROOT), ignore=shutil.ignore_patterns("__pycache__")
        )
    for name in ("pyproject.toml", "setup.py", "LICENSE", "README.md", "protocol/SPEC.md"):
        shutil.copy(ROOT / name, copy / name)
    return copy


def run(*command, cwd, **environment):
    """Run *command* without the caller's import path; return its exit status and output."""
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=inherited | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout


def broken_contracts(tree):
    """Names of the import contracts that *tree* breaks."""
    status, output = run(
        *(sys.executable, "-c", "from importlinter import cli; cli.lint_imports_command()"),
        *("--no-logo", "--no-cache"),
        cwd=tree,
        PYTHONPATH=os.pathsep.join([str(tree), str(tree / "protocol")]),
        COLUMNS="500",  # a verdict on one line
    )
    verdicts = dict(re.findall(r"^(.*) (KEPT|BROKEN)\b", output, re.MULTILINE))
    assert set(verdicts) == set(CONTRACTS.values()), output
    assert status == ("BROKEN" in verdicts.values()), output
    return {name for name, verdict in verdicts.items() if verdict == "BROKEN"}


@pytest.mark.nightly  # with a commit ci/test itself asks for the contracts
def test_every_import_contract_is_kept(tree):
    assert broken_contracts(tree) == set()


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("contract", "lines"), PLANTS, ids=[contract for contract, _ in PLANTS])
def test_a_forbidden_import_is_reported(tree, contract, lines):
    for path, line in lines.items():
        with (tree / path).open("a") as module:
            module.write(f"\n{line}\n")
    broken = broken_contracts(tree)
    assert CONTRACTS[contract] in broken
    # An import against the layers often closes a circle as well.
    assert broken <= {CONTRACTS[contract], CONTRACTS["no-circles"]}


def test_every_import_contract_is_proven_to_fail():
    assert {contract for contract, _ in PLANTS} == set(CONTRACTS)


def rooms():
    """Yield every folder of the packages, with the names of its modules and folders."""
    for source in SOURCES.values():
        for folder in (source, *source.rglob("*")):
            if (folder / "__init__.py").is_file():
                names = {path.name for path in folder.iterdir()}
                yield folder, names - {"__init__.py", "__main__.py", "__pycache__", "py.typed"}


ROOMS = dict(rooms())
MOST_IN_A_ROOM = 14


def test_a_room_is_small_and_says_what_lives_there():
    for folder, names in ROOMS.items():
        text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text("utf-8"))) or ""
        assert text.split("\n")[0].endswith("."), folder
        is_small = len(names) <= MOST_IN_A_ROOM or f"{len(names)} rooms, because" in text
        assert is_small, folder


def test_every_folder_with_modules_is_a_room():
    strays = {
        path.parent
        for source in SOURCES.values()
        for path in source.rglob("*.py")
        if path.parent not in ROOMS
    }
    assert strays == set()


def test_the_architecture_page_draws_every_room():
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    drawn = set(re.findall(r"^ +(\w+)/(?= |$)", page, re.MULTILINE))
    assert drawn <= {folder.name for folder in ROOMS}
    assert drawn >= {folder.name for folder in ROOMS if folder.parent in SOURCES.values()}


# --- the prose of public docstrings: no clause of "what" as a noun

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


@pytest.mark.parametrize("package", SOURCES)
def test_no_public_docstring_begins_with_a_clause(package):
    assert [
        clause
        for path in sorted(SOURCES[package].rglob("*.py"))
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


@pytest.mark.parametrize("package", SOURCES)
def test_every_error_derives_from_the_root_of_its_package(package):
    errors = {
        value
        for module in modules(package)
        for _, value in inspect.getmembers(module, inspect.isclass)
        if issubclass(value, BaseException) and value.__module__ == module.__name__
    }
    strays = {error for error in errors if not issubclass(error, ERROR_ROOTS[package])}
    assert strays == set()


@pytest.mark.parametrize("package", SOURCES)
def test_every_exported_name_exists_once(package):
    for module in modules(package):
        names = list(getattr(module, "__all__", ()))
        assert len(names) == len(set(names)), module.__name__
        assert [name for name in names if not hasattr(module, name)] == [], module.__name__


def test_importing_prints_nothing_and_starts_no_thread():
    names = [module.__name__ for package in SOURCES for module in modules(package)]
    status, output = run(
        *(sys.executable, "-W", "ignore", "-c"),
        "import importlib, sys, threading; sys.path[:0] = sys.argv[1].split(':'); "
        "[importlib.import_module(name) for name in sys.argv[2:]]; "
        "sys.exit(threading.active_count() - 1)",
        *(f"{ROOT}:{ROOT / 'protocol'}", *names),
        cwd=ROOT,
    )
    assert (status, output) == (0, "")


def repository_files():
    """Text of every file that git holds or would take; without git, of the packages' modules."""
    status, listing = run("git", "ls-files", "-z", "-co", "--exclude-standard", cwd=ROOT)
    paths = (
        [ROOT / name for name in listing.split("\0") if name]
        if status == 0
        else [path for source in SOURCES.values() for path in source.rglob("*.py")]
    )
    for path in paths:
        if path.is_file():
            yield path.relative_to(ROOT), path.read_bytes().decode("utf-8", "replace")


def test_no_file_names_a_place_on_one_machine():
    homes = r"/(?:home|root|Users)/\w|[A-Z]:\\Users\\"
    machine = re.compile(rf"(?<![\w.])(?:{homes}|{re.escape(str(ROOT))}/)")
    named = {str(path) for path, text in repository_files() if machine.search(text)}
    assert named - {"tests/test_architecture.py"} == set()


@pytest.mark.nightly
def test_wheel_works_in_a_foreign_directory(tree, tmp_path):
    """Firmware repositories tend to have a `protocol/` and a `tests/` of their own."""
    site = clean_environment(tmp_path / "env", built_wheel(tree, tmp_path))

    suffixes = {".py", ".typed", ".html", ".css"}
    packed = {path.relative_to(site) for path in site.rglob("*") if path.suffix in suffixes}
    assert packed == {
        Path(package, path.relative_to(source))
        for package, source in SOURCES.items()
        for path in source.rglob("*")
        if path.suffix in suffixes
    }

    foreign = tmp_path / "firmware"
    for folder in ("protocol", "tests"):
        (foreign / folder).mkdir(parents=True)
        (foreign / folder / "__init__.py").write_text("raise RuntimeError('this is not ours')\n")
    status, output = run(
        *(tmp_path / "env" / "bin" / "python", "-c"),
        "import haptogram, haptogram_protocol, sim_device, haptogram.acoustics; "
        "print(haptogram.__file__, haptogram_protocol.__file__, sim_device.__file__)",
        cwd=foreign,
    )
    assert (status, output.split()) == (0, [str(site / name / "__init__.py") for name in SOURCES])

    assert (site / "haptogram_protocol" / "SPEC.md").read_bytes() == SPEC.read_bytes()
    status, output = run(
        *(tmp_path / "env" / "bin" / "python", "-m", "haptogram", "conform", "--list"), cwd=foreign
    )
    assert status == 0, output
    assert "HG-5.7/1" in output


@pytest.mark.nightly
def test_a_source_distribution_builds_the_same_wheel(tree, tmp_path):
    status, output = run(
        *(sys.executable, "-c"),
        "import sys; from setuptools.build_meta import build_sdist; build_sdist(sys.argv[1])",
        tmp_path,
        cwd=tree,
    )
    assert status == 0, output
    (source,) = tmp_path.glob("*.tar.gz")
    folders = [tmp_path / "from_tree", tmp_path / "from_source"]
    for folder in folders:
        folder.mkdir()
    wheels = [built_wheel(*job) for job in zip((tree, source), folders, strict=True)]
    listings = [ZipFile(wheel).namelist() for wheel in wheels]
    assert sorted(listings[0]) == sorted(listings[1])


def built_wheel(source, folder):
    """Build a wheel in *folder* from a source tree or a source distribution, off line."""
    status, output = run(
        *(sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--quiet"),
        *("--disable-pip-version-check", "--wheel-dir", folder, source),
        cwd=folder,
    )
    assert status == 0, output
    (wheel,) = folder.glob("*.whl")
    return wheel


def clean_environment(folder, wheel):
    """Make an environment that holds *wheel* and, for the dependencies, reads those of this one."""
    venv.create(folder, symlinks=True)
    python = folder / "bin" / "python"
    _, output = run(
        python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder
    )
    site = Path(output.strip())
    with ZipFile(wheel) as archive:
        archive.extractall(site)
    # Read after the wheel, and without its own .pth files: an editable install there stays unseen.
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
    return site
