"""The recipe of SonicSurface's page passes the right program and fails every wrong one, by name."""

import dataclasses
import re
import shlex
from pathlib import Path

import pytest

from haptogram.acoustics import Medium
from haptogram.cli import main
from trials.wrong_programs import RIGHT, RIGHT_PAIR, WRONG, Program

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "boards" / "sonicsurface.md"
AUTD3 = PAGE.with_name("autd3.md")
FAR_M, FREQUENCY_HZ = 0.3, 40e3  # from an element to a focus
OF_PAGE_MM = ((20, 150, -15), (0, 120, 0))


def recipe() -> list[str]:
    """The words of the page's command, without the board that it starts and what it expects."""
    command = re.search(r"```bash\nhaptogram (watch .*?) &\n", PAGE.read_text(), re.DOTALL)
    words = shlex.split(command[1].replace("\\\n", ""))
    for option in ("--link", "--latches"):
        at = words.index(option)
        del words[at : at + 2]
    assert [w for w in words if w.startswith("--expect=")] == expected(OF_PAGE_MM)
    return [word for word in words if not word.startswith("--expect")]


def expected(targets_mm) -> list[str]:
    return ["--expect=" + ",".join(map(str, target)) for target in targets_mm]


def run(program: Program, folder: Path, capsys) -> tuple[int, str]:
    command, *words = recipe()
    (folder / "program.bin").write_bytes(program.bytes())
    boards = ["--dialect-option", "boards=2"] if len(program.elements_mm) > 1 else []
    words += [*boards, *expected(program.targets_mm)]
    return main([command, str(folder / "program.bin"), *words]), capsys.readouterr().out


@pytest.mark.sampled(1)
@pytest.mark.parametrize("program", [RIGHT, RIGHT_PAIR], ids=["one board", "two boards"])
def test_the_right_program_passes(program, tmp_path, capsys):
    assert run(program, tmp_path, capsys)[0] == 0


def test_its_bytes_are_those_of_the_client():
    for target in OF_PAGE_MM:
        name = "focus_" + "_".join(map(str, target)).replace("-", "m")
        seen = (ROOT / "tests" / "data" / "dialects" / "sonicsurface" / f"{name}.bin").read_bytes()
        assert dataclasses.replace(RIGHT, targets_mm=[target]).bytes() == seen


@pytest.mark.sampled(3)
@pytest.mark.slow
@pytest.mark.parametrize("wrong", WRONG, ids=lambda wrong: wrong.name)
def test_every_wrong_program_fails_and_is_named(wrong, tmp_path, capsys):
    status, out = run(wrong.program, tmp_path, capsys)
    assert status in (1, 3), out
    assert re.search(wrong.told, out, re.DOTALL), out
    if wrong.of_two_foci and not wrong.program.elements_mm[1:]:  # with those of the page as well
        of_page = dataclasses.replace(wrong.program, targets_mm=OF_PAGE_MM)
        assert run(of_page, tmp_path, capsys)[0] in (1, 3)


@pytest.mark.parametrize(("page", "speed_m_s", "steps"), [(PAGE, 346, 32), (AUTD3, 340, 256)])
def test_the_air_of_a_page_is_that_of_its_client(page: Path, speed_m_s: float, steps: int) -> None:
    """As near as the steps ask: else phases that are right are more than half a step off."""
    command = re.search(r"--temperature-c (\S+)", page.read_text())
    off = Medium.air(float(command[1])).sound_speed_m_s / speed_m_s - 1
    far_turns = FAR_M * FREQUENCY_HZ / speed_m_s
    assert abs(off) * far_turns < 0.1 * 0.5 / steps


def test_there_are_26_of_them():
    assert len({wrong.name for wrong in WRONG}) == 26
