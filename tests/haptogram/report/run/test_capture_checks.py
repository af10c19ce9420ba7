"""The checks by drive pins: what each says of the elements that another check names."""

from __future__ import annotations

from haptogram.report.run.pins import run_capture_checks


def found_by_checks(findings: dict[str, list[str]]) -> dict[str, str]:
    """Return the messages, by check, of a capture of three pins with *findings*."""
    capture = {
        "capture": "pins.vcd",
        "verdict": "fail" if findings else "pass",
        "reasons": [],
        "findings": findings,
        "not_judged": {},
        "elements": [0, 1, 2],
        "frames": {"judged": 4, "intended": 4},
    }
    return {check.group: check.message for check in run_capture_checks({"captures": [capture]})}


def test_a_pin_that_is_inverted_is_not_among_those_of_a_right_phase() -> None:
    dead = found_by_checks({"pins": ["element 1 (e1): inverted"]})
    right = "none of 3 captured elements"
    besides = f"{right}, besides the pins that are dead, stuck or inverted"
    assert (dead["pins_phases"], dead["pins_amplitudes"]) == (besides, besides)
    assert dead["pins_torn"] == right
    assert found_by_checks({})["pins_phases"] == right
