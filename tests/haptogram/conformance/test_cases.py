"""Every clause has a case, every case a clause, and the clauses are those of SPEC.md."""

import re
from collections import Counter
from pathlib import Path

from haptogram.conformance import cases
from haptogram.conformance.case import Case
from haptogram.conformance.cases import all_cases, case_modules, cases_in, select
from haptogram.conformance.cases.ch04_session.identity import LEAST_LIMITS
from haptogram.conformance.clauses import (
    Clause,
    Level,
    load_clauses,
    parse_spec,
    read_spec_of_clauses,
)
from haptogram.conformance.outcome import WIRE

ROOT = Path(__file__).parents[3]
SPEC = (ROOT / "protocol" / "SPEC.md").read_text("utf-8")
CASES = all_cases()


def test_a_checkout_reads_its_own_spec():
    assert read_spec_of_clauses() == SPEC


def test_a_clause_is_its_number_and_its_text_on_one_line():
    text = "intro\n- **HG-3.4/1** A board MUST\n  do this.\n- **HG-3.4/2** It MAY not.\n\nmore\n"
    assert parse_spec(text) == (
        Clause("HG-3.4/1", "A board MUST do this."),
        Clause("HG-3.4/2", "It MAY not."),
    )


def test_every_clause_that_demands_something_has_a_case():
    with_case = {case.clause for case in CASES}
    assert [number for number in load_clauses() if number not in with_case] == []


def test_every_case_has_a_clause():
    assert [case.id for case in CASES if case.clause not in load_clauses()] == []


def test_every_line_that_begins_like_a_clause_was_read():
    assert len(load_clauses()) == SPEC.count("\n- **HG-")


def test_a_chapter_folder_holds_the_cases_of_its_chapter_and_no_others():
    for module in case_modules():
        chapter = int(re.fullmatch(r".*\.ch(\d\d)_[a-z]+\.[a-z_]+", module.__name__)[1])
        cases = cases_in(module)
        found = {load_clauses()[c.clause].order[0] for c in cases if not asks_of_every(c)}
        assert found <= {chapter}, module.__name__


def asks_of_every(case):
    """One that asks at every type or length lies in the chapter of its subject."""
    return case.body is not None and ".every_" in f"{case.body.__module__}.{case.body.__name__}"


def test_no_file_of_a_chapter_is_left_out():
    folder = Path(cases.__file__).parent
    files = {path for path in folder.rglob("*.py") if path.name != "__init__.py"}
    assert {Path(module.__file__) for module in case_modules()} == files
    assert sum(len(cases_in(module)) for module in case_modules()) == len(CASES)


def test_a_module_names_the_sections_of_its_cases_in_its_first_line():
    for module in case_modules():
        named = module.__doc__.replace("\n", " ").partition(": ")[0].split(", ")
        sections = {load_clauses()[case.clause].section for case in cases_in(module)}
        assert named == sorted(sections, key=lambda name: Clause(name, "").order), module.__name__


def test_ids_are_unique():
    assert [name for name, count in Counter(case.id for case in CASES).items() if count > 1] == []


def test_cases_are_in_the_order_of_the_text():
    order = [load_clauses()[case.clause].order for case in CASES]
    assert order == sorted(order)


def test_every_case_says_in_one_line_what_it_does():
    is_report = re.compile(r".{11,119}").fullmatch
    assert [case.id for case in CASES if not is_report(case.summary)] == []


def test_level_is_the_strongest_word():
    assert Clause("HG-1.2/1", "A board SHOULD do this and MUST do that.").level is Level.MUST
    assert Clause("HG-1.2/1", "A board SHOULD do this and MAY do that.").level is Level.SHOULD


def test_selection_by_case_clause_section_and_chapter():
    # In two pieces: a number with its letters has to be that of a clause that there is.
    letters = "HG"
    cases = [Case(f"{letters}-{number}", "x", None) for number in ("1.1/1", "1.1/10", "1.10/1")]
    cases.append(Case(f"{letters}-10.1/1", "x", None, variant="y", evidence=WIRE))

    def chosen(name):
        return [case.id.removeprefix("HG-") for case in select(cases, [f"{letters}-{name}"])]

    assert chosen("1.1/1") == ["1.1/1"]
    assert chosen("1.1") == ["1.1/1", "1.1/10"]
    assert chosen("1") == ["1.1/1", "1.1/10", "1.10/1"]
    assert chosen("10.1/1-y") == chosen("10.1/1") == ["10.1/1-y"]
    assert chosen("9") == []


def test_the_least_limits_are_those_of_the_table():
    rows = re.findall(r"^\| `(\w+)` \| ([\d ]+)\b[^|]*\|", SPEC, re.MULTILINE)
    table = {name: int(least.replace(" ", "")) for name, least in rows}
    judged = {name: least for name, least, _ in LEAST_LIMITS}
    assert judged == {name: table[name] for name in judged}
