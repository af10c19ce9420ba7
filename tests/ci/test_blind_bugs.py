"""``ci/blind-bugs``: bugs of the C board are built, judged, counted and remembered."""

import difflib
import json

import pytest

from blind_bugs.__main__ import main
from blind_bugs.building import HEALTHY, Bug, BuildError, build
from protocol_c.building import FOLDER, compiler

CRC = "if (hg_crc32(0, body, length) != hg_get_u32(body + length))"


def patch(file, old, new, *, root="protocol/c/", clause=""):
    text = (FOLDER / file).read_text()
    assert old in text
    lines, changed = (t.splitlines(keepends=True) for t in (text, text.replace(old, new)))
    diff = difflib.unified_diff(lines, changed, f"a/{root}{file}", f"b/{root}{file}")
    return (f"Clause: {clause}\n" if clause else "") + "".join(diff)


@pytest.fixture
def bugs(tmp_path):
    compiler()
    folder = tmp_path / "bugs"
    folder.mkdir()
    unchecked = patch("haptogram_codec.c", CRC, "if (0)", clause="HG-2.4/2")
    harmless = patch("haptogram_codec.c", CRC, f"{CRC} /* as it was */", root="")
    (folder / "crc.patch").write_text(unchecked)
    (folder / "harmless.diff").write_text(harmless)
    (folder / "stale.patch").write_text(unchecked.replace("hg_crc32", "hg_crc"))
    return folder


@pytest.mark.nightly
def test_bugs_are_caught_missed_and_remembered(bugs, capsys):
    words = [str(bugs), "--clause", "HG-2.4/2", "--grid", "3x2", "--jobs", "1"]
    assert main(words) == 2  # one patch does not apply
    out = capsys.readouterr().out
    assert "caught  crc [HG-2.4/2]: HG-2.4/2" in out
    assert "MISSED  harmless (exit status 0)" in out
    assert "ERROR   stale: does not apply" in out
    assert "caught 1 of 2 (50 %)" in out
    kept = bugs / "results" / "crc-virtual.json"
    found = json.loads(kept.read_text())
    kept.write_text(json.dumps(found | {"failed": {}}))  # judged again, it would be caught
    main(words)
    assert "MISSED  crc" in capsys.readouterr().out
    main([*words, "--seed", "1"])
    assert "caught  crc" in capsys.readouterr().out


@pytest.mark.nightly
@pytest.mark.pty
def test_on_a_pty_hardware_faults_are_judged_too(bugs, capsys):
    for path in bugs.iterdir():
        path.unlink()
    silent = patch(
        "board/board.c",
        "    if (board->state != before)\n        output_send_state",
        "    if (0)\n        output_send_state",
    )
    (bugs / "unsaid.patch").write_text(silent)
    words = [str(bugs), "--clock", "wall", "--clause", "HG-6.8/1-fault", "--grid", "3x2"]
    main(words)
    assert "caught  unsaid: HG-6.8/1-fault" in capsys.readouterr().out


@pytest.mark.nightly
def test_a_board_that_does_not_compile_is_named(tmp_path):
    compiler()
    bug = Bug("typo", patch("haptogram_codec.c", CRC, "if (nothing)"), "")
    with pytest.raises(BuildError, match=r"does not compile: .*nothing"):
        build(bug, FOLDER, tmp_path)
    assert HEALTHY.patch == ""


def test_a_folder_without_patches(tmp_path):
    with pytest.raises(SystemExit, match="there is no"):
        main([str(tmp_path)])
