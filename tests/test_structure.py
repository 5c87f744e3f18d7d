"""The structure of the package, as far as a machine can judge it: lengths of functions, numbers and columns without a name."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parent.parent / "src" / "curvescan"
MATCHER = SOURCE / "matchers" / "curvescan"

MAX_LINES = 60
PLAIN = (0.0, 0.5, 1.0, 2.0)
"""Floats that need no name; others are constants of a module, with unit and reason, or fields of a config."""

N_POSE = 3
"""Indices below it are those of a pose, a point or a small matrix; other columns have names."""

LONG = {
    "benchmark.py:run_benchmark",
    "batch.py:batch",  # commands: one parameter a flag
    "calibrate.py:calibrate",
    "evaluate.py:evaluate",
    "live.py:live",
    "experiments.py:run_experiments",
    "run.py:run",
    "run.py:run_slam",
    "optimization.py:_accumulate",
}
"""Functions that are longer."""


def _functions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def long_functions(text: str) -> list[str]:
    """Functions that are too long, their docstrings left out, by name."""
    found = []
    for f in _functions(ast.parse(text)):
        words = f.body[0].end_lineno - f.body[0].lineno + 1 if ast.get_docstring(f) else 0
        if f.end_lineno - f.lineno + 1 - words > MAX_LINES:
            found.append(f.name)
    return found


def unnamed_numbers(text: str) -> list[str]:
    """Floats that stand in functions, and have no name."""
    return [
        f"{f.name}:{node.lineno}: {node.value}"
        for f in _functions(ast.parse(text))
        for node in ast.walk(f)
        if isinstance(node, ast.Constant)
        and isinstance(node.value, float)
        and node.value not in PLAIN
    ]


def unnamed_columns(text: str) -> list[str]:
    """Columns of arrays, and items of long tuples, that are named by a number."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.Subscript):
            continue
        last = node.slice.elts[-1] if isinstance(node.slice, ast.Tuple) else node.slice
        if isinstance(last, ast.Constant) and isinstance(last.value, int) and last.value >= N_POSE:
            found.append(f"{node.lineno}: {ast.unparse(node)}")
    return found


def test_functions_fit_a_screen():
    found = {
        f"{path.name}:{name}"
        for path in SOURCE.rglob("*.py")
        for name in long_functions(path.read_text())
    }
    assert found <= LONG


@pytest.mark.parametrize("path", sorted(MATCHER.rglob("*.py")), ids=lambda p: p.stem)
def test_numbers_and_columns_of_the_matcher_have_names(path):
    text = path.read_text()
    # a config's numbers are its fields' defaults; what its functions check is 0, 1 or a field
    assert unnamed_numbers(text) == []
    assert unnamed_columns(text) == []


def test_what_has_no_name_is_found():
    text = "LIMIT = 0.3\ndef f(a):\n    return a[:, 7] + a[12] * 0.25 - a[2] * LIMIT * 0.5\n"
    assert unnamed_numbers(text) == ["f:3: 0.25"]
    assert unnamed_columns(text) == ["3: a[:, 7]", "3: a[12]"]
    assert long_functions("def f():\n" + "    x = 1\n" * MAX_LINES) == ["f"]
    words = '    """A.\n\n    B.\n    """\n'
    assert long_functions("def f():\n" + words + "    x = 1\n" * (MAX_LINES - 1)) == []
