"""The tool that mutates the package: its named mutants still fit the sources, and what it loads is the mutant."""

from __future__ import annotations

import ast
import importlib.util
import sys

import pytest

mutants = pytest.importorskip("tests.mutants", reason="processes are not forked on this system")


@pytest.mark.parametrize("mutant", mutants.NAMED, ids=lambda mutant: mutant.name)
def test_a_named_mutant_stands_once_in_its_file_and_parses(mutant):
    ast.parse(mutant.source())
    assert mutant.old != mutant.new
    assert all((mutants.ROOT / "tests" / one).exists() for one in mutant.tests)


def test_the_module_that_is_loaded_is_the_mutant(monkeypatch):
    (mutant,) = [m for m in mutants.NAMED if "stale" in m.name]
    spec = mutants._Finder(mutant).find_spec("curvescan.diagnostics.issues", None)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)  # where its dataclasses look
    spec.loader.exec_module(module)
    assert module._STALE == 0.4
    assert mutants._Finder(mutant).find_spec("curvescan.diagnostics.inspect", None) is None


def test_mutants_by_rule_change_one_place_each():
    file = "curvescan/matchers/curvescan/assessment/labels.py"
    found = list(mutants.mutants_of(file))
    assert len({(m.offset, m.old, m.new) for m in found}) == len(found) > 40
    original = (mutants.SOURCE / file).read_text()
    for mutant in found[::5]:
        changed = mutant.source()
        ast.parse(changed)
        assert changed != original
        assert changed.startswith(original[: mutant.offset])
        assert changed.endswith(original[mutant.offset + len(mutant.old) :])


def test_every_file_of_the_rooms_has_tests():
    assert len(mutants.files()) > 20
    for file in mutants.files():
        assert all((mutants.ROOT / "tests" / one).exists() for one in mutants._tests_of(file))
