"""The command that records the dialogues, with the C board that it builds."""

from haptogram.conformance.cases import all_cases, select
from protocol_c.building import compiler
from protocol_vectors.vector_files import read
from vector_recorder import __main__ as command


def test_the_command_records_what_was_frozen(tmp_path, monkeypatch, capsys):
    compiler()
    monkeypatch.setattr(command, "all_cases", lambda: select(all_cases(), ["HG-12"]))
    path = tmp_path / "dialogues.json"
    assert command.main([str(path)]) == 0
    frozen = [v for v in read("dialogues.json")["vectors"] if v["flags"] == ["timers"]]
    assert read(path)["vectors"] == frozen
    assert capsys.readouterr().out == f"{path}: {len(frozen)} dialogues\n"
