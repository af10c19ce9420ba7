"""The CI recipes for firmware, the action, the container: their steps, in a clean environment.

The submodule is a copy of this tree. The firmware is the virtual board in a process of its own,
which stand-ins for make, qemu and openocd start. Where QEMU and the ARM compiler are there, the
recipe for the emulator runs with them and real firmware, too.
"""

import contextlib
import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sysconfig
import tomllib
import venv
from pathlib import Path

import pytest
import yaml

from firmware_check.ports import PORTS, build, missing_tool

ROOT = Path(__file__).resolve().parents[2]
RECIPES = {
    "github": ROOT / "docs" / "ci" / "github-actions.yml",
    "gitlab": ROOT / "docs" / "ci" / "gitlab-ci.yml",
}
KINDS = ("native", "qemu", "board")
SUBMODULE = "tools/haptogram"
ACTION = ROOT / ".github" / "actions" / "haptogram"
CONTAINER = ROOT / "ci" / "Containerfile"
NOT_SOURCE = ("*.egg-info", ".git", ".venv", ".*_cache", "__pycache__", "build", "out")
#: Two cases that a loaded machine judges too; the whole suite has tests of its own.
FEW = " --clause HG-2.3 --clause HG-6.1 --timeout 5 --boot-timeout 60"
DEVICE = "/dev/ttyACM0"
TCP_PORT = "7000"

START_BOARD = """\
export PYTHONPATH="$PYTHONPATH:$SUBMODULE:$SUBMODULE/protocol"
rm -f board
python3 -m sim_device --array 4x4 --link board > board.log 2>&1 < /dev/null &
echo $! > board.pid
until [ -e board ]; do sleep 0.02; done
"""
PROGRAMS = {
    "make": f"""\
case $1 in
native) mkdir -p build; cp "$STAND_INS/firmware" build/firmware_native ;;
firmware.elf) cp "${{FIRMWARE:-/dev/null}}" firmware.elf ;;
flash) {START_BOARD} ;;
*) exit 2 ;;
esac
""",
    "firmware": f'{START_BOARD}echo "PTY is $(readlink board)"\nwait\n',
    "qemu-system-arm": """\
case "$*" in *"-M musca-b1 "*" -kernel firmware.elf"*) [ -e firmware.elf ] || exit 2 ;;
*) exit 2 ;; esac
port=$(echo "$*" | sed 's/.*-serial tcp:127.0.0.1:\\([0-9]*\\),.*/\\1/')
export PYTHONPATH="$PYTHONPATH:$SUBMODULE:$SUBMODULE/protocol"
exec python3 -m sim_device --array 4x4 --tcp "$port" > board.log 2>&1 < /dev/null
""",
    "openocd": f"""\
kill $(cat board.pid)
while kill -0 $(cat board.pid) 2>/dev/null; do sleep 0.02; done
{START_BOARD}""",
    "sudo": 'exec "$@"\n',
    "apt-get": "case $1 in update) ;; install) echo $* > installed ;; *) exit 2 ;; esac\n",
}


def jobs(name):
    """The jobs of a recipe by the kind of their board: what a shell runs at once, its variables."""
    read = yaml.safe_load(RECIPES[name].read_text("utf-8"))
    if name == "github":
        assert read[True] == ["push", "pull_request"]  # YAML 1.1 reads "on" as a truth
        return {kind: list(steps_of(read["jobs"][kind]["steps"])) for kind in KINDS}
    assert read["variables"] == {"GIT_SUBMODULE_STRATEGY": "normal"}
    assert all(read[f"conformance:{kind}"]["extends"] == ".conformance" for kind in KINDS)
    found = {kind: read[".conformance"] | read[f"conformance:{kind}"] for kind in KINDS}
    whole = {kind: [*job["before_script"], *job["script"]] for kind, job in found.items()}
    return {kind: [("\n".join(lines), {})] for kind, lines in whole.items()}


def steps_of(steps, inputs=None):
    """Yield what shells run, with its variables: of the steps, and of our action among them."""
    for step in steps:
        if "run" in step:
            yield step["run"], {k: filled_in(v, inputs) for k, v in step.get("env", {}).items()}
        elif step["uses"].startswith("./"):
            assert step["uses"] == f"./{SUBMODULE}/{ACTION.relative_to(ROOT)}"
            action = yaml.safe_load((ACTION / "action.yml").read_text("utf-8"))
            known = {name: row["default"] for name, row in action["inputs"].items()}
            assert step["with"].keys() <= known.keys()
            yield from steps_of(action["runs"]["steps"], known | step["with"])
        elif "checkout" in step["uses"]:
            assert step["with"] == {"submodules": True}
        else:
            assert step["uses"].startswith("actions/upload-artifact@")


def filled_in(text, inputs):
    """Return *text* with the inputs of an action in place of its expressions."""
    return re.sub(r"\$\{\{ inputs\.(\w+) \}\}", lambda found: inputs[found[1]], text)


@pytest.fixture(scope="module")
def submodule(tmp_path_factory):
    """A checkout of this tree."""
    folder = tmp_path_factory.mktemp("submodule") / "haptogram"
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*NOT_SOURCE))
    return folder


@pytest.fixture(scope="module")
def machine(submodule, tmp_path_factory):
    """The variables of a machine with Python, Haptogram's dependencies, and no Haptogram."""
    folder = tmp_path_factory.mktemp("machine")
    venv.create(folder / "python", with_pip=True, symlinks=True)
    dependencies, programs = folder / "dependencies", folder / "programs"
    for place in (dependencies, programs):
        place.mkdir()
    for package in Path(sysconfig.get_path("purelib")).iterdir():
        if not package.name.startswith(("haptogram", "__editable__", "pip", "_distutils")):
            (dependencies / package.name).symlink_to(package)
    for name, text in PROGRAMS.items():
        (programs / name).write_text(f"#!/bin/sh\n{text}")
        (programs / name).chmod(0o755)
    return {
        "PATH": f"{programs}:{folder / 'python' / 'bin'}:/usr/bin:/bin",
        "HOME": str(folder),
        "PYTHONPATH": str(dependencies),
        "STAND_INS": str(programs),
        "SUBMODULE": str(submodule),
        # The dependencies are there; nothing is looked up.
        "PIP_NO_DEPS": "1",
        "PIP_NO_INDEX": "1",
        "PIP_DISABLE_PIP_VERSION_CHECK": "1",
        "PIP_NO_BUILD_ISOLATION": "0",  # which means that there is none
    }


@pytest.mark.pty
@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", RECIPES)
def test_the_steps_of_a_recipe_run(name, kind, machine, tmp_path):
    run_steps(name, kind, machine, tmp_path)
    if kind == "qemu":
        assert "qemu-system-arm" in (tmp_path / "installed").read_text()


@pytest.mark.nightly
@pytest.mark.skipif(bool(missing_tool()), reason=f"not run: {missing_tool()}")
@pytest.mark.parametrize("name", RECIPES)
def test_the_steps_for_the_emulator_run_with_real_firmware(name, machine, tmp_path):
    firmware = build(PORTS["musca_b1"], tmp_path / "build", CFLAGS="-O1")
    real = tmp_path / "programs"
    shutil.copytree(machine["STAND_INS"], real)
    (real / "qemu-system-arm").unlink()
    path = machine["PATH"].replace(machine["STAND_INS"], str(real))
    (tmp_path / "work").mkdir()
    variables = machine | {"PATH": path, "FIRMWARE": str(firmware)}
    run_steps(name, "qemu", variables, tmp_path / "work")
    assert "256 transducers" in (tmp_path / "work" / "said").read_text()


def run_steps(name, kind, machine, tmp_path):
    """Run the steps of a recipe in a folder; the board has to pass."""
    (tmp_path / "conformance").mkdir()
    (tmp_path / "conformance" / "expected.toml").write_text("[expected]\n")
    (tmp_path / SUBMODULE).parent.mkdir()
    (tmp_path / SUBMODULE).symlink_to(machine["SUBMODULE"])
    job = {
        "GITHUB_ACTIONS": "true",
        "GITHUB_ACTION_PATH": str(tmp_path / SUBMODULE / ACTION.relative_to(ROOT)),
        "GITHUB_STEP_SUMMARY": str(tmp_path / "summary.md"),
        "RUNNER_TEMP": str(tmp_path / "runner"),
    }
    machine = machine | (job if name == "github" else {})
    said, port = "", str(free_tcp_port())
    try:
        for script, variables in jobs(name)[kind]:
            text = script.rstrip() + FEW if "haptogram conform" in script else script
            if "ARGUMENTS" in variables:
                variables = variables | {
                    "ARGUMENTS": here(variables["ARGUMENTS"] + FEW, tmp_path, port)
                }
            said += shell(here(text, tmp_path, port), variables | machine, tmp_path)
    finally:
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            os.kill(int((tmp_path / "board.pid").read_text()), signal.SIGTERM)
    assert "2 OK" in said
    assert "PASS (exit status 0)" in said
    (page,) = tmp_path.glob("conform*.xml")
    assert page.name == ("conform.xml" if name == "gitlab" else f"conform-{kind}.xml")
    if name == "github":
        assert (tmp_path / "summary.md").read_text().startswith("## haptogram conform: PASS: ")
    (tmp_path / "said").write_text(said)


def here(text, folder, tcp_port):
    return text.replace(DEVICE, str(folder / "board")).replace(TCP_PORT, tcp_port)


def free_tcp_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def shell(script, variables, folder):
    """Run a step as both services do: the first command that fails ends it."""
    done = subprocess.run(
        ["bash", "-eo", "pipefail", "-c", script],
        cwd=folder,
        env=variables,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, f"{script}\n{done.stdout}"
    return done.stdout


@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_has_nothing_that_a_user_must_fill_in(name):
    text = RECIPES[name].read_text("utf-8")
    assert "git submodule add" in text
    assert not re.search(r"\b[A-Z]{3,}/|@[A-Z]{3,}|<\w+>|your-", text)
    for place in re.findall(rf"\./{SUBMODULE}([^\s\"\[]*)", text):
        assert (ROOT / place.lstrip("/")).exists()


@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_has_the_three_kinds_of_boards(name):
    found = jobs(name)
    marks = ("--spawn ./build/firmware_native", "exec qemu-system-arm", f"--port {DEVICE}")
    for kind, mark in zip(KINDS, marks, strict=True):
        assert mark in str(found[kind])


@pytest.mark.nightly
@pytest.mark.slow
def test_the_container_has_what_its_commands_need(machine, tmp_path):
    """Without an engine: the files are copied, the commands run, in a folder for its root."""
    lines = CONTAINER.read_text("utf-8").splitlines()
    rows = [line.partition(" ")[::2] for line in lines if line and not line.startswith("#")]
    assert [word for word, _ in rows].count("FROM") == 1
    for word, rest in rows:
        if word == "COPY":
            *sources, target = rest.split()
            (tmp_path / target.strip("/")).mkdir(parents=True, exist_ok=True)
            for source in sources:
                copy_to_container(ROOT / source, tmp_path / target.strip("/"), target)
        elif word == "RUN":
            shell(rest.replace("/src", str(tmp_path / "src")), machine, tmp_path)
        elif word == "WORKDIR":
            (tmp_path / rest.strip("/")).mkdir()
        elif word == "ENTRYPOINT":
            start = shlex.join(json.loads(rest))
            said = shell(
                f"{start} conform --clause HG-2.3 --clause HG-6.1", machine, tmp_path / "work"
            )
            assert "2 OK" in said
        else:
            assert (word, rest.partition("-")[0]) == ("FROM", "python:3.12")


def copy_to_container(source, folder, target):
    """Copy as COPY does: a file into a folder that ends with /, the content of a folder."""
    if source.is_dir():
        shutil.copytree(
            source, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns(*NOT_SOURCE)
        )
    else:
        assert target.endswith("/")
        shutil.copy(source, folder)


# --- the project's own workflow -------------------------------------------------------------------

WORKFLOW = ROOT / ".github" / "workflows" / "ci.yml"


def test_the_workflow_runs_the_commands_of_the_readme_on_every_python():
    test = yaml.safe_load(WORKFLOW.read_text("utf-8"))["jobs"]["test"]
    readme = (ROOT / "README.md").read_text("utf-8")
    runs = [step["run"] for step in test["steps"] if "run" in step]
    assert runs == ["ci/test", "ci/verify"]
    assert all(f"\n{command} " in readme for command in runs)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    prefix = "Programming Language :: Python :: 3."
    classified = [line for line in project["classifiers"] if line.startswith(prefix)]
    versions = test["strategy"]["matrix"]["python-version"]
    assert versions == [f"3.{line.removeprefix(prefix)}" for line in classified]
    assert project["requires-python"] == f">={versions[0]}"
    (setup,) = (step for step in test["steps"] if "setup-python" in step.get("uses", ""))
    assert setup["with"]["python-version"] == "${{ matrix.python-version }}"


def test_every_command_of_the_workflow_is_there():
    for job in yaml.safe_load(WORKFLOW.read_text("utf-8"))["jobs"].values():
        for step in job["steps"]:
            assert ("uses" in step) != ("run" in step)
            if "run" in step and not step["run"].startswith("docker "):
                assert os.access(ROOT / step["run"].split()[0], os.X_OK)
            if step.get("uses", "").startswith("./"):
                assert (ROOT / step["uses"] / "action.yml").exists()
