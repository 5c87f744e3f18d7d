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
    assert found == set()


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
    assert len(graph) > 200
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


MAX_COLUMNS = 120
MAX_TOTAL_LINES, MAX_ARGUMENTS = 60, 8

MOST_LONG, MOST_ARGUMENTS = 3, 2
"""Functions of more than MAX_TOTAL_LINES with their docstrings, and of more than MAX_ARGUMENTS arguments."""

MOST_WIDE = {"src": 0, "tests": 0, "docs": 0}
"""Wide lines: 0 is the aim."""

PLAIN_NUMBERS = (0.0, 0.5, 1.0, 2.0, -1.0)
"""Floats that nobody tunes; neither are those of 1e-6 and smaller, which guard divisions."""

BUDGET: dict[str, tuple[int, int, int]] = {
    "(ground)": (1704, 34, 0),
    "benchmarks": (482, 23, 0),
    "cli": (2647, 16, 0),
    "diagnostics": (2284, 73, 0),
    "editing": (454, 2, 0),
    "engines": (812, 2, 0),
    "evaluation": (829, 15, 0),
    "io": (5964, 38, 0),
    "live": (2799, 41, 0),
    "mapping": (960, 17, 8),
    "matchers": (675, 4, 0),
    "matchers/baselines": (1528, 44, 35),
    "matchers/cfsma": (1103, 15, 17),
    "matchers/curvescan": (3397, 83, 22),
    "odometry": (1401, 28, 20),
    "paper": (1606, 84, 0),
    "plots": (724, 36, 0),
    "runs": (1222, 13, 0),
    "runs/batch": (1630, 5, 0),
    "se2": (439, 0, 0),
    "simulation": (1955, 85, 0),
    "slam": (4000, 57, 18),
}
"""Lines, tuned numbers and config fields that a room may have: they go down, and this table with them."""


def tuned(node: ast.AST) -> int:
    """Count the floats below a node that somebody could tune."""
    floats = (n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, float))
    return sum(value not in PLAIN_NUMBERS and abs(value) > 1e-6 for value in floats)


def size(text: str) -> tuple[int, int, int]:
    """Lines, tuned numbers and config fields of a file: of constants, of functions, and all defaults of configs."""
    tree = ast.parse(text)
    n_numbers = sum(tuned(n.value) for n in tree.body if isinstance(n, ast.Assign | ast.AnnAssign) and n.value)
    n_numbers += sum(tuned(part) for f in _functions(tree) for part in f.body)
    n_fields = 0
    for c in (n for n in ast.walk(tree) if isinstance(n, ast.ClassDef)):
        fields = [n for n in c.body if isinstance(n, ast.AnnAssign)]
        if not c.name.endswith("Config"):
            n_numbers += sum(tuned(n.value) for n in c.body if isinstance(n, ast.Assign | ast.AnnAssign) and n.value)
            continue
        n_fields += len(fields)
        values = (
            n.value for field in fields if field.value for n in ast.walk(field.value) if isinstance(n, ast.Constant)
        )
        n_numbers += sum(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    return len(text.splitlines()), n_numbers, n_fields


def room_of(path: Path) -> str:
    """The folder that a file of the package is counted in."""
    folders = path.relative_to(SOURCE).parts[:-1]
    return "/".join(folders[: 2 if folders and folders[0] in ("matchers", "runs") else 1]) or "(ground)"


def test_rooms_keep_to_their_budget():
    sizes: dict[str, list[tuple[int, int, int]]] = {}
    for path in SOURCE.rglob("*.py"):
        sizes.setdefault(room_of(path), []).append(size(path.read_text()))
    found = {room: tuple(map(sum, zip(*files, strict=True))) for room, files in sizes.items()}
    assert found.keys() <= BUDGET.keys()
    over = {
        room: (now, BUDGET[room])
        for room, now in found.items()
        if any(n > most for n, most in zip(now, BUDGET[room], strict=True))
    }
    assert over == {}, "a rule or a number that comes in takes one out"


READS_TRACES = ("plots", "paper", "benchmarks")
"""Rooms that look into what a matcher did on the way; all others take its result alone."""


def test_only_figures_and_experiments_read_the_trace_of_a_match():
    readers = {
        f"{path.relative_to(SOURCE)}:{node.lineno}"
        for path in SOURCE.rglob("*.py")
        if path.relative_to(SOURCE).parts[0] not in READS_TRACES
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute) and node.attr == "trace" and ast.unparse(node.value) != "np"
    }
    assert readers == set()


def test_few_functions_are_long_or_take_many_arguments():
    long, many = [], []
    for path in SOURCE.rglob("*.py"):
        for f in _functions(ast.parse(path.read_text())):
            names = [a.arg for a in (*f.args.posonlyargs, *f.args.args, *f.args.kwonlyargs)]
            if f.end_lineno - f.lineno + 1 > MAX_TOTAL_LINES:
                long.append(f"{path.name}:{f.name}")
            if len(names) - (names[:1] in (["self"], ["cls"])) > MAX_ARGUMENTS:
                many.append(f"{path.name}:{f.name}")
    assert len(long) <= MOST_LONG, long
    assert len(many) <= MOST_ARGUMENTS, many


def test_few_lines_are_wide():
    root = SOURCE.parent.parent
    files = {
        "src": SOURCE.rglob("*.py"),
        "tests": (root / "tests").rglob("*.py"),
        "docs": [*(root / "docs").rglob("*.md"), root / "README.md"],
    }
    for part, paths in files.items():
        wide = [
            f"{path.relative_to(root)}:{k}"
            for path in paths
            for k, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
            if len(line) > MAX_COLUMNS
        ]
        assert len(wide) <= MOST_WIDE[part], wide


def test_what_is_tuned_is_counted():
    text = "A = (0.3, 0.5)\nclass XConfig:\n    a: int = 3\n    b: bool = True\ndef f():\n    return 0.7 + 1e-9\n"
    assert size(text) == (6, 3, 2)
