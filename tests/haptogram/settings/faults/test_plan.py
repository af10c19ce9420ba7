"""Fault plans: texts, TOML, limits; and docs/faults.md against the table of faults."""

import math
import re
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.errors import ConfigurationError
from haptogram.settings.board import BoardConfig
from haptogram.settings.faults.kinds import (
    FAULT_KINDS,
    PLACES,
    described_faults,
    fault_number_text,
    fault_words,
)
from haptogram.settings.faults.plan import Fault, FaultPlan, faults_of_toml

MS = 1_000_000
DOCS = Path(__file__).resolve().parents[4] / "docs" / "faults.md"
EXAMPLE = 'seed = 7\n\n[[fault]]\nname = "line.flip"\nber = 1e-5\nfrom = "2s"\n'


@st.composite
def fault_texts(draw):
    name = draw(st.sampled_from(sorted(FAULT_KINDS)))
    words, places = [], [key for key in FAULT_KINDS[name] if key in PLACES]
    for key, limits in FAULT_KINDS[name].items():
        if key in PLACES:
            continue
        if limits.whole:
            number = st.integers(int(limits.least), int(limits.most))
        else:
            number = st.floats(limits.least, limits.most)
        words += draw(st.lists(number.map(lambda n, key=key: f"{key}={n!r}"), max_size=1))
    if places:
        words.append(f"{draw(st.sampled_from(places))}={draw(st.integers(0, 9))}")
    from_ns, length_ns = draw(st.integers(1, 10**12)), draw(st.integers(1, 10**12))
    times = {"from": f"from={from_ns}ns", "until": f"until={from_ns + length_ns}ns"}
    may = [key for key in fault_words(name) if key in times]
    if name == "line.disconnect" and words:
        may.remove("until")
    said = draw(st.sets(st.sampled_from(may))) if may else set()
    return " ".join([name, *words, *(times[key] for key in sorted(said))])


# --- text and TOML -----------------------------------------------------------------------------


@given(st.lists(fault_texts(), max_size=4), st.integers(0, 2**64 - 1))
def test_a_plan_can_be_pasted_back_as_text_and_as_toml(texts, seed):
    plan = FaultPlan.parse(texts, seed)
    assert FaultPlan(*faults_of_toml(tomllib.loads(plan.as_toml()))) == plan
    assert FaultPlan.parse([str(fault) for fault in plan.faults], seed) == plan


def test_toml_says_the_same_as_the_command_line():
    assert FaultPlan(*faults_of_toml(tomllib.loads(EXAMPLE))) == FaultPlan.parse(
        ["line.flip ber=1e-5 from=2s"], 7
    )
    assert faults_of_toml({}) == ((), None)


def test_a_file_and_the_command_line_add_up(tmp_path):
    file = tmp_path / "plan.toml"
    file.write_text(EXAMPLE)
    plan = BoardConfig.of(fault=["line.break"], fault_plan=file, seed=1).plan
    assert [fault.name for fault in plan.faults] == ["line.flip", "line.break"]
    assert plan.seed == 7
    assert BoardConfig.of(fault_plan=file, fault_seed=8).plan.seed == 8
    assert BoardConfig.of(seed=1).plan == FaultPlan((), 1)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("sead = 1", "sead is not read; known are seed and [[fault]]"),
        ("seed = -1", "seed = -1, must be a whole number, 0 to 18446744073709551615"),
        (f"seed = {2**64}", f"seed = {2**64}, must be a whole number, 0 to 1844674407370955161"),
        ("seed = true", "seed = True"),
        ("fault = 1", "must have tables"),
        ("[[fault]]\nber = 1", "a table [[fault]] has no name"),
        ('[[fault]]\nname = "line.flip"\nber = 2', "ber=2, must be 0 to 1"),
        ('[[fault]]\nname = "line.flip"\nber = [1]', "ber=[1], must be a number, 0 to 1"),
        ('[[fault]]\nname = "line.flip"\nfrom = 2', "must be a time"),
    ],
)
def test_toml_that_makes_no_sense_is_refused_as_text_is(text, problem):
    with pytest.raises(ConfigurationError, match=re.escape(problem)):
        faults_of_toml(tomllib.loads(text))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("device.dead column=1.5", "column=1.5, must be a whole number"),
        ("device.garbage bank=1 column=1", "must have either"),
        ("line.flip direction=left", "must be down, up or both"),
        ("frame.crc direction=up", "no parameter 'direction'"),
        ("line.baud ppm=3e5", "must be -200000 to 200000"),
        ("line.flip from=-1s", "must not be before power-up"),
    ],
)
def test_texts_that_make_no_sense(text, problem):
    with pytest.raises(ConfigurationError, match=re.escape(problem)):
        Fault.parse(text)


@pytest.mark.parametrize(
    ("name", "key"), [(name, key) for name, kind in FAULT_KINDS.items() for key in kind]
)
def test_a_value_that_a_parameter_does_not_have_is_refused_with_its_limits(name, key):
    limits = FAULT_KINDS[name][key]
    low, high = map(fault_number_text, (limits.least, limits.most))
    beyond = [limits.least - 1 - abs(limits.least), limits.most * 2 + 1, math.inf, math.nan]
    texts = [*map(repr, beyond), "5ms", "x", "", *(["1.5"] if limits.whole else [])]
    for text in texts:
        with pytest.raises(ConfigurationError) as caught:
            Fault.parse(f"{name} {key}={text}")
        message = str(caught.value)
        assert message.startswith(f"{name} {key}=")
        assert message.endswith(f"{low} to {high}")
        assert "\n" not in message


def test_every_fault_is_in_the_documentation_with_what_it_takes():
    rows = re.findall(r"^\| `([a-z]+\.[a-z_]+)` \| (.*?) \|", DOCS.read_text(), re.MULTILINE)
    documented = dict(rows)
    for text in described_faults():
        name, *words = text.split()
        expected = " ".join(word for word in words if "=N" not in word)
        assert expected in documented.pop(name).replace("`", ""), text
    assert not documented


# --- what cannot be, however a fault is given -----------------------------------------------------

SPAN = "must not be before power-up (0s), nor after 4611686018s"
NEVER = {
    "line.flip from=5s until=1s": "line.flip from=5s until=1s: until must be after 5s",
    "line.flip from=2s until=2s": "line.flip from=2s until=2s: until must be after 2s",
    "line.flip until=0s": "line.flip from=0s until=0s: until must be after 0s",
    "line.flip until=-1s": f"line.flip until=-1s: {SPAN}",
    "line.flip from=-1ns": f"line.flip from=-1ns: {SPAN}",
    "line.flip from=1e10s": f"line.flip from=1e10s: {SPAN}",
    "line.flip until=1e10s": "line.flip until=1e10s: must not be before power-up",
    "line.flip from=nans": "line.flip from=nans: must be a time such as 2s",
    "line.flip from=infs": "line.flip from=infs: must be a time such as 2s",
    "line.flip from=1e999s": "line.flip from=1e999s: must be a time such as 2s",
    "line.flip from=2": "line.flip from=2: must be a time such as 2s",
    "line.flip from=": "line.flip from=: must be a time such as 2s",
    "line.flip from=s": "line.flip from=s: must be a time such as 2s",
    "line.flip ber": "line.flip ber=, must be a number, 0 to 1",
    "line.flip ber=nan": "line.flip ber=nan, must be 0 to 1",
    "line.flip ber=inf": "line.flip ber=inf, must be 0 to 1",
    "line.flip ber=-1": "line.flip ber=-1, must be 0 to 1",
    "line.slice bytes=1e300": "line.slice bytes=",
    "line.delay us=1e10": "line.delay us=10000000000, must be 0 to 1000000000",
    "line.disconnect ms=0": "line.disconnect ms=0, must be 1e-06 to 1000000000",
    "line.disconnect ms=5 until=9s": "line.disconnect ms=5 until=9s: say either how long, or until",
    "line.disconnect from=2s until=1s": "line.disconnect from=2s until=1s: until must be after 2s",
    "clock.step us=-1": "clock.step us=-1, must be 0 to 1000000000",
    "clock.step until=2s": "clock.step has no parameter 'until'; known: us, from",
    "clock.offset from=2s": "clock.offset has no parameter 'from'; known: us",
    "clock.wrap until=2s": "clock.wrap has no parameter 'until'; known: us",
    "device.off transducer=-1": "device.off transducer=-1, must be 0 to 65535",
    "device.off": "device.off: must have either transducer=N, column=N or bank=N",
    "device.off bank=0 column=1": "device.off column=1 bank=0: must have either",
}
NEVER |= {  # every kind that takes times
    f"{name} {place}from=5s until=1s": f"{name} from=5s until=1s: until must be after 5s"
    for name in FAULT_KINDS
    if "until" in fault_words(name)
    for place in ["bank=0 " if "bank" in FAULT_KINDS[name] else ""]
}


def toml_of(text):
    name, *words = text.split()
    lines = [f'{key} = "{value}"' for key, _, value in (word.partition("=") for word in words)]
    return "\n".join(["[[fault]]", f'name = "{name}"', *lines])


def refused(act):
    with pytest.raises(ConfigurationError) as caught:
        act()
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(("text", "problem"), NEVER.items())
def test_what_cannot_be_is_refused_with_fault_parameter_value_and_limit(text, problem):
    assert problem in refused(lambda: FaultPlan.parse([text]))
    assert problem in refused(lambda: faults_of_toml(tomllib.loads(toml_of(text))))


@pytest.mark.parametrize(
    ("fault", "problem"),
    [
        (
            ("line.flip", {"ber": 0.1}, 5, 1),
            "line.flip from=5ns until=1ns: until must be after 5ns",
        ),
        (("line.flip", {"ber": 0.1}, -5), "line.flip from=-5ns: must not be before power-up"),
        (("line.flip", {"ber": 0.1}, 1 << 62), "nor after"),
        (("line.flip", {"ber": float("nan")}), "line.flip ber=nan, must be 0 to 1"),
        (("line.flip", {"ber": "1"}), "line.flip ber='1', must be a number, 0 to 1"),
        (("line.flip", {}), "line.flip: its parameters are ber"),
        (("line.flip", {"ber": 0.1}, 0, 9, "left"), "must be down, up or both"),
        (("frame.crc", {"p": 0.1}, 0, 9, "both"), "frame.crc direction=both, must be down"),
        (("line.disconnect", {"ms": 5.0}, 0, 9), "line.disconnect ms=5 until=9ns: say either"),
        (("line.slice", {"bytes": 1.5, "gap_us": 0}), "bytes=1.5, must be a whole number"),
        (("line.flop", {}), "'line.flop' is no fault; did you mean line.flip?"),
    ],
)
def test_a_fault_that_is_made_by_hand_is_refused_too(fault, problem):
    assert problem in refused(lambda: Fault(*fault))


@pytest.mark.parametrize(
    ("texts", "problem"),
    [
        ("line.flip", "faults is 'line.flip', must be a list such as ['line.flip ber=1e-5']"),
        (b"line.flip", "faults is b'line.flip', must be a list"),
        (None, "faults is None, must be a list"),
        (5, "faults is 5, must be a list"),
        ([5], "faults[0] is 5, must be a text such as 'line.flip ber=1e-5'"),
        ([None], "faults[0] is None, must be a text"),
        ([b"line.flip"], "faults[0] is b'line.flip', must be a text"),
        ([["line.flip"]], "faults[0] is ['line.flip'], must be a text"),
        (["line.flip ber=1 ber=0.5"], "line.flip ber=0.5: ber is said twice"),
        (["line.flip from=1s from=2s"], "line.flip from=2s: from is said twice"),
    ],
)
def test_what_is_no_list_of_texts_is_refused(texts, problem):
    assert problem in refused(lambda: FaultPlan.parse(texts))


def test_a_plan_is_made_of_faults():
    assert "FaultPlan.parse" in refused(lambda: FaultPlan(("line.flip",)))


def test_a_string_of_a_file_does_not_break_the_line():
    text = '[[fault]]\nname = "line.flip"\nber = "a\\nb"\n'
    assert "ber=a b, must be a number, 0 to 1" in refused(
        lambda: faults_of_toml(tomllib.loads(text))
    )


def test_a_port_may_be_gone_until_a_time():
    fault = Fault.parse("line.disconnect from=1s until=3s")
    assert (fault.from_ns, fault.until_ns) == (1_000 * MS, 3_000 * MS)
    assert str(fault) == "line.disconnect from=1s until=3s"
    assert Fault.parse(str(fault)) == fault
