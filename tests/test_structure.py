"""The structure of the package, as far as a machine can judge it.

Imports that go in a circle, sizes of folders, lengths of functions, numbers and columns without a name.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parent.parent / "src" / "curvescan"
MATCHER = SOURCE / "matchers" / "curvescan"

MAX_FILES = 15
"""Of a folder; what is more has rooms of its own."""

MAX_LINES = 60
PLAIN = (0.0, 0.5, 1.0, 2.0)
"""Floats that need no name; others are constants of a module, with unit and reason, or fields of a config."""

N_POSE = 3
"""Indices below it are those of a pose, a point or a small matrix; other columns have names."""

LONG = {"calibrate.py:calibrate", "live.py:live"}
"""Functions that are longer: commands, with one parameter a flag."""


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
        if isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value not in PLAIN
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
    found = {f"{path.name}:{name}" for path in SOURCE.rglob("*.py") for name in long_functions(path.read_text())}
    assert found == LONG


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


def imports_of(text: str, package: str) -> set[str]:
    """Names of modules that a file imports, wherever it does: at its top, in a function, or by a name in a table.

    Each is given with what is taken from it, which may be a module itself. What only type checkers see is left out.
    """
    found: set[str] = set()

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            for child in node.orelse:
                visit(child)
            return
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package.rsplit(".", node.level - 1)[0] if node.level else ""
            module = ".".join(filter(None, (base, node.module)))
            found.update(f"{module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Constant) and re.fullmatch(r"curvescan(\.\w+)+(:\w+)?", str(node.value)):
            found.add(str(node.value).replace(":", "."))
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(text))
    return found


def import_graph(root: Path = SOURCE) -> dict[str, set[str]]:
    """The modules of the package that each of its modules imports."""
    files = {".".join(path.relative_to(root.parent).with_suffix("").parts): path for path in root.rglob("*.py")}
    files = {name.removesuffix(".__init__"): path for name, path in files.items()}
    graph: dict[str, set[str]] = {}
    for name, path in files.items():
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        imported = imports_of(path.read_text(), package)
        # the longest known name: `from a import b` takes the module a.b, or the name b of a
        known = {m if m in files else m.rpartition(".")[0] for m in imported}
        graph[name] = (known & files.keys()) - {name}
    return graph


def grouped(graph: Mapping[str, set[str]], depth: int) -> dict[str, set[str]]:
    """The same between folders, as deep as so many names; the root's facade, which names everything, is left out."""
    rooms: dict[str, set[str]] = {}
    for name, imported in graph.items():
        if name == "curvescan":
            continue
        room = ".".join(name.split(".")[:depth])
        others = {".".join(m.split(".")[:depth]) for m in imported if m != "curvescan"}
        rooms.setdefault(room, set()).update(others - {room})
    return rooms


def circle_in(graph: Mapping[str, set[str]]) -> list[str]:
    """The modules of one circle, the first again at its end; empty where there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_import_goes_in_a_circle():
    graph = import_graph()
    assert len(graph) > 300
    assert circle_in(graph) == []
    for depth in (2, 3, 4, 5):
        assert circle_in(grouped(graph, depth)) == []


def test_a_circle_is_found_though_it_is_lazy(tmp_path):
    root = tmp_path / "curvescan"
    (root / "room").mkdir(parents=True)
    (root / "__init__.py").write_text("")
    (root / "room" / "__init__.py").write_text("")
    (root / "a.py").write_text("def f():\n    from curvescan.room import b\n")
    (root / "room" / "b.py").write_text('TABLE = {"a": "curvescan.a:f"}\n')
    assert set(circle_in(import_graph(root))) == {"curvescan.a", "curvescan.room.b"}
    (root / "room" / "b.py").write_text("if TYPE_CHECKING:\n    from curvescan.a import f\n")
    assert circle_in(import_graph(root)) == []
    (root / "room" / "b.py").write_text("from .. import a\n")
    assert set(circle_in(import_graph(root))) == {"curvescan.a", "curvescan.room.b"}
    (root / "room" / "b.py").write_text("")
    (root / "room" / "c.py").write_text("from curvescan.a import f\n")  # no module's, but a room's
    assert circle_in(import_graph(root)) == []
    assert set(circle_in(grouped(import_graph(root), 2))) == {"curvescan.a", "curvescan.room"}


@pytest.mark.parametrize(
    "folder", sorted({path.parent for path in SOURCE.rglob("*.py")}), ids=lambda p: str(p.relative_to(SOURCE.parent))
)
def test_a_folder_is_small_and_says_what_it_is_for(folder):
    assert len(list(folder.glob("*.py"))) <= MAX_FILES
    first = (ast.get_docstring(ast.parse((folder / "__init__.py").read_text())) or "").splitlines()
    assert first
    assert first[0].endswith(".")
