"""Date, version, machine and command line of a result."""

from __future__ import annotations

import pytest

from haptogram.errors import ConfigurationError
from haptogram.machine.provenance import UNSTATED, Provenance, read_provenance_stamp


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("2026-11-22", "2026-11-22T00:00:00"),
        ("2026-11-22T15:00", "2026-11-22T15:00:00"),
        ("2026-11-22T15:00:01.7Z", "2026-11-22T15:00:01"),
        ("2026-11-22 15:00+02:00", "2026-11-22T13:00:00"),
    ],
)
def test_a_stamp_is_a_date_in_utc(text: str, shown: str) -> None:
    origin = Provenance.of_run("haptogram verify", text)
    assert origin.timestamp == shown
    assert ("date", f"{shown.replace('T', ' ')} UTC") in origin.rows()


@pytest.mark.parametrize(
    "text", ["", "today", "2026-13-01", "0001-01-01T00:00+23:59", "1700000000"]
)
def test_what_is_no_date_is_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match=r"^--stamp is '.*', must be a date of ISO 8601"):
        read_provenance_stamp(text)


def test_a_result_in_virtual_time_states_its_version_only_unless_it_is_stamped() -> None:
    plain = Provenance.of_run("haptogram verify", None)
    assert [name for name, _ in plain.rows()] == ["date", "version", "machine", "command"]
    assert plain.of_virtual_time() == UNSTATED
    assert [name for name, _ in UNSTATED.rows()] == ["version"]
    stamped = Provenance.of_run("haptogram verify", "2026-11-22")
    assert stamped.of_virtual_time() is stamped
