"""The public face: names, examples that run, the page that lists the names, the version."""

import doctest
import importlib
import inspect
import re
import types
from pathlib import Path

import pytest

import haptogram

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("haptogram", "haptogram.acoustics")
PLACES = {  # by name; of a name in both packages the second one, whose example it shows
    name: package for package in PACKAGES for name in importlib.import_module(package).__all__
}
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for package in ("haptogram", "sim_device")
    for path in sorted((ROOT / package).rglob("*.py"))
    if ">>> from haptogram" in (text := path.read_text()) or ">>> from sim_device" in text
]


def examples(text, name, namespace):
    """Return the doctest of the section Examples in *text*."""
    section = inspect.cleandoc(text).partition("\nExamples\n--------\n")[2]
    return doctest.DocTestParser().get_doctest(section, namespace, name, None, None)


def run(test):
    """Run a doctest and return what it reports of its failures, and its namespace."""
    reports = []
    doctest.DocTestRunner(verbose=False).run(test, out=reports.append, clear_globs=False)
    return "".join(reports), test.globs


def namespace_of(package):
    """Return a namespace in which the example of *package* was run."""
    module = importlib.import_module(package)
    report, namespace = run(examples(module.__doc__, package, {}))
    assert report == ""
    return namespace


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_lists_its_public_names_and_nothing_else(package):
    module = importlib.import_module(package)
    assert dir(module) == sorted(module.__all__)
    listed = [getattr(module, name) for name in dir(module)]
    assert not [value for value in listed if isinstance(value, types.ModuleType)]


@pytest.mark.parametrize("name", PLACES)
def test_every_public_name_has_an_example_that_runs(name):
    package = PLACES[name]
    module = importlib.import_module(package)
    value = getattr(module, name)
    if isinstance(value, types.UnionType):  # an alias cannot have a docstring of its own
        assert {member.__name__ for member in value.__args__} <= set(module.__all__)
        return
    test = examples(value.__doc__, name, namespace_of(package))
    assert test.examples, "its docstring has no section Examples"
    report, _ = run(test)
    assert report == ""


@pytest.mark.parametrize("name", MODULES)
def test_an_example_of_other_names_imports_what_it_shows(name):
    found = doctest.DocTestFinder().find(importlib.import_module(name))
    alone = [
        test
        for test in found
        if test.name.rpartition(".")[2] not in PLACES
        and any(one.source.startswith("from ") for one in test.examples)
    ]
    assert "".join(run(test)[0] for test in alone) == ""


def test_a_name_in_both_packages_is_one_thing():
    host, acoustics = map(importlib.import_module, PACKAGES)
    for name in set(host.__all__) & set(acoustics.__all__):
        assert getattr(host, name) is getattr(acoustics, name)


def test_an_example_that_is_wrong_is_reported():
    report, _ = run(examples("Doc.\n\nExamples\n--------\n>>> 1 + 1\n3\n", "wrong", {}))
    assert "Expected:\n    3\nGot:\n    2" in report
    assert not examples("Doc.\n\n>>> 1 + 1\n2\n", "no section", {}).examples


@pytest.mark.parametrize("package", PACKAGES)
def test_the_page_lists_the_public_names(package):
    page = (ROOT / "docs" / "api.md").read_text()
    section = page.partition(f"\n## `{package}`\n")[2].partition("\n## ")[0]
    listed = re.findall(r"`(\w+)`", section)
    assert sorted(listed) == sorted(importlib.import_module(package).__all__)


def test_the_citation_has_the_version_of_the_package():
    citation = (ROOT / "CITATION.cff").read_text()
    assert re.search(r"^cff-version: 1\.2\.0$", citation, re.MULTILINE)
    assert re.findall(r"^version: (.+)$", citation, re.MULTILINE) == [haptogram.__version__]
