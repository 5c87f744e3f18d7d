"""Mutants: the package with one thing wrong, and whether the tests of its room notice; `make mutants`, not in CI.

Named mutants first, each something a user would feel; then those made by rule of each file of the default matcher and
of the odometry: numbers doubled and halved, comparisons widened and turned round, conditions and operands left out. A
mutant lives in memory: the finder below hands its source to one forked process, which runs the tests without the JIT.
(mutmut leaves decorated functions alone, and here the kernels are; cosmic-ray rewrites files in place, adds one to
numbers of which most are shares, and runs the same tests for all.)
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import importlib.abc
import importlib.util
import os
import random
import resource
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "src"
MATCHER = "curvescan/matchers/curvescan"
ROOMS = {MATCHER: "test_matcher.py", "curvescan/odometry": "test_odometry.py"}
"""Folders that are mutated, and the tests of their files that have none of their own."""

_MAX_SLOWER = 8.0  # a mutant may take so many times the processor time of the original, and hangs beyond
_ELSEWHERE = {  # files that others' tests are nearest to
    f"{MATCHER}/candidates.py": "test_disambiguation.py",
    "curvescan/odometry/config.py": "test_gating.py",
    "curvescan/odometry/gaps.py": "test_recovery.py",
    "curvescan/odometry/strategies.py": "test_recovery.py",
}
_NO_CODE = ("__init__.py", "step.py", "features.py")


class Mutant(NamedTuple):
    """One change: `old` becomes `new` at an offset of a file, relative to src; `tests` relative to tests."""

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]
    offset: int = -1

    def source(self) -> str:
        """Return the changed text of the file."""
        text = (SOURCE / self.file).read_text()
        if self.offset < 0 and text.count(self.old) != 1:
            raise SystemExit(
                f"mutant {self.name!r}: {self.old!r} must stand once in {self.file}, "
                f"stands {text.count(self.old)} times"
            )
        at = text.index(self.old) if self.offset < 0 else self.offset
        return text[:at] + self.new + text[at + len(self.old) :]


def _named(name: str, file: str, old: str, new: str, *tests: str) -> Mutant:
    return Mutant(name, f"curvescan/{file}", old, new, tests or _tests_of(f"curvescan/{file}"))


def _tests_of(file: str) -> tuple[str, ...]:
    """Return the tests of a file of the package: those of its own name, in the folder that mirrors its room."""
    folder = Path(file).parent.relative_to("curvescan")
    name = _ELSEWHERE.get(file, f"test_{Path(file).name}")
    for place in (folder, folder.parent):
        if (ROOT / "tests" / place / name).exists():
            return (str(place / name),)
    room = next(room for room in ROOMS if file.startswith(room))
    return (str(Path(room).relative_to("curvescan") / ROOMS[room]),)


_MATCHER = "matchers/curvescan"
NAMED = (
    _named(
        "agreement at 2 sigma instead of 3",
        f"{_MATCHER}/assessment/labels.py",
        "return SURE_SIGMAS * math.sqrt",
        "return 2.0 * math.sqrt",
    ),
    _named(
        "a line's own noise 0.9 instead of 0.3",
        f"{_MATCHER}/assessment/information.py",
        "_LINE_NOISE = 0.3",
        "_LINE_NOISE = 0.9",
    ),
    _named(
        "robust knee 9 instead of 4, outliers beyond 36",
        f"{_MATCHER}/refinement.py",
        "_KNEE_CHI2 = LIKELY_SIGMAS * LIKELY_SIGMAS",
        "_KNEE_CHI2 = 9.0",
    ),
    _named(
        "walls across both axes count along one",
        f"{_MATCHER}/proposal/hypotheses.py",
        "if not is_wall or abs(fx) > 2.0 * abs(fy):",
        "if not is_wall or abs(fx) > abs(fy):",
    ),
    _named(
        "a jamb is a thing that somebody may have moved",
        f"{_MATCHER}/features/objects.py",
        "n_found, begin = k if inwards > 0.0 else 0, i",
        "n_found, begin = k, i",
    ),
    _named(
        "what stands against a wall stays for good",
        f"{_MATCHER}/assessment/information.py",
        "_LASTS = 60.0",
        "_LASTS = 1e12",
        f"{_MATCHER}/features/test_objects.py",
    ),
    _named(
        "the two sides of a wall are one surface",
        f"{_MATCHER}/assessment/labels.py",
        "reach = 0.0 if faces_away(surfels, i, motion) else ",
        "reach = ",
    ),
    _named(
        "what half a turn may explain is sure",
        f"{_MATCHER}/disambiguation.py",
        "is_same_turned = (is_open or",
        "is_same_turned = 0.0 * (is_open or",
    ),
    _named(
        "what may keep pace is sure", f"{_MATCHER}/disambiguation.py", "assessment.may_keep_pace and not is_open", "0.0"
    ),
    _named(
        "things keep pace for an hour",
        f"{_MATCHER}/assessment/information.py",
        "max(least, 2.0 * false[0]) and not is_later",
        "max(least, 2.0 * false[0])",
        f"{_MATCHER}/features/test_objects.py",
    ),
    _named("share of a slide 0.2 instead of 0.7", f"{_MATCHER}/disambiguation.py", "_SHARE = 0.7", "_SHARE = 0.2"),
    _named(
        "motion gate three times as wide",
        "odometry/config.py",
        "motion_gate_chi2: float = 20.0",
        "motion_gate_chi2: float = 60.0",
        "odometry/test_gating.py",
    ),
    _named("pauses clamped ten times later", "odometry/motion_model.py", "_MAX_STRETCH = 20\n", "_MAX_STRETCH = 200\n"),
    _named(
        "stale share 0.4 instead of 0.1",
        "diagnostics/issues.py",
        "_STALE = 0.1",
        "_STALE = 0.4",
        "diagnostics/test_issues.py",
    ),
    _named(
        "residuals above the noise do not widen the covariance",
        f"{_MATCHER}/assessment/information.py",
        "scale = 0.5 / max(",
        "scale = 0.5 / min(1.0, ",
    ),
    _named(
        "spurious information of tilted lines stays",
        f"{_MATCHER}/assessment/information.py",
        "unit * (system[INFORMATION + k] - part[INFORMATION + k] - spurious_part)",
        "unit * (system[INFORMATION + k] - part[INFORMATION + k])",
    ),
    _named(
        "poses across the pi seam are different ones",
        f"{_MATCHER}/proposal/scoring.py",
        "min(turn, 2.0 * math.pi - turn)",
        "turn",
    ),
    _named(
        "lines may face away from each other in refinement",
        f"{_MATCHER}/refinement.py",
        "if mx * nx + my * ny < _FACING:",
        "if False:",
    ),
    _named(
        "keyframes are asked three standard deviations off",
        "slam/loop_search.py",
        "_SIGMAS = 5.0",
        "_SIGMAS = 3.0",
        "slam/test_closures.py",
    ),
    _named("no soft weight between 2 and 4 sigma", f"{_MATCHER}/refinement.py", "if u2 > _KNEE_CHI2:", "if False:"),
    _named(
        "one leap is a habit",
        "odometry/motion_model.py",
        "square = min(square, self.config.motion_gate_chi2 * variance)",
        "pass",
    ),
    _named(
        "a rejected match keeps its small covariance",
        "odometry/measurement.py",
        "expected.covariance + prediction.recovery",
        "expected.covariance",
        "odometry/test_gating.py",
    ),
    _named(
        "the motion that a match found is not expected next",
        "odometry/motion_model.py",
        "            last=motion,",
        "            last=self.last,",
    ),
    _named(
        "closures are accepted alone where the graph is vague",
        "slam/loops/closures.py",
        "if expectation + tried.log_odds > config.closures.log_odds:",
        "if True:",
        "slam/test_closures.py",
    ),
    _named(
        "what a match of keyframes leaves open is measured",
        "slam/loops/closures.py",
        "found := as_measurement(result)",
        "found := UncertainPose(result.pose, result.covariance)",
        "slam/test_closures.py",
    ),
    _named(
        "views that share nothing may be of one place",
        "slam/loops/closures.py",
        "claims.append(within_sight(found, along, *views))",
        "claims.append(found)",
        "slam/test_closures.py",
    ),
    _named(
        "wheels say nothing against people who keep pace",
        "odometry/measurement.py",
        "against = min(slip_odds(off, distance), CERTAIN)",
        "against = -math.inf",
        "odometry/test_gating.py",
    ),
    _named(
        "a leap of wheels is a slip of theirs",
        "odometry/wheels.py",
        "return told.interrupted()  # it leapt",
        "pass",
        "odometry/test_wheels.py",
    ),
    _named(
        "views of one place are independent witnesses",
        "slam/loops/agreement.py",
        "total += float(new[k] / _VIEW_M * said[k])",
        "total += float(said[k])",
        "slam/test_agreement.py",
    ),
    _named(
        "what leaves a way open helps what does not",
        "slam/loops/agreement.py",
        "before = np.flatnonzero(whole[:-1] == whole[-1])",
        "before = np.arange(last)",
        "slam/test_agreement.py",
    ),
    _named(
        "a set in doubt says as much as a sure one",
        "slam/loops/agreement.py",
        "MOST_LOG_ODDS * (float(said.max()) / MOST_ODDS)",
        "MOST_LOG_ODDS",
        "slam/test_agreement.py",
    ),
    _named(
        "of a lost track the search knows nothing",
        "slam/pose_graph/graph.py",
        "return covariances - is_lost(covariances)[:, np.newaxis, np.newaxis] * LOST_COVARIANCE",
        "return covariances.copy()",
        "slam/test_growing_map.py",
    ),
    _named(
        "a step that slipped loses its weight for good",
        "slam/pose_graph/robust.py",
        "new = np.maximum(tls_weights(distances, limits, convexity), least)",
        "new = tls_weights(distances, limits, convexity)",
        "slam/test_robust.py",
    ),
    _named(
        "the last optimization begins once",
        "slam/growing_map.py",
        "optimum = min(optimum, freed, key=lambda one: one.costs.sum())",
        "del freed",
        "slam/test_growing_map.py",
    ),
    _named(
        "a set against the map is followed whatever it costs",
        "slam/loop_search.py",
        "if said + max(failed, 0.0) > cost_of(members, graph, alone.costs):",
        "if said > 0.0:",
        "slam/test_audit.py",
    ),
    _named(
        "what fails where the map has the keyframes of a set says nothing for it",
        "slam/loop_search.py",
        "if said + max(failed, 0.0) > cost_of",
        "if said > cost_of",
        "slam/test_audit.py",
    ),
    _named(
        "a keyframe that went hangs on its match whatever the finished map says",
        "slam/thinning.py",
        "tie if fuse(step.seen, UncertainPose(by_tie, tie.seen.covariance + spread))[1] < GATE else step",
        "tie",
    ),
    _named(
        "closures of a keyframe that goes stay where they were",
        "slam/thinning.py",
        "moved = compose(from_other, edge)",
        "moved = edge",
        "slam/test_thinning.py",
    ),
)
"""Some that once lived in the tests of their own file, and others that did."""

_WIDER = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "=="}
_TURNED = {ast.Lt: ">=", ast.LtE: ">", ast.Gt: "<=", ast.GtE: "<"}
_OPERATORS = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"}
_SIGNS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}


def mutants_of(file: str) -> Iterator[Mutant]:
    """Yield the mutants of a file, relative to src, by rule."""
    text = (SOURCE / file).read_text()
    lines = text.encode().splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line))

    def segment(node: ast.expr) -> tuple[int, str]:
        begin = starts[node.lineno - 1] + node.col_offset
        end = starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)
        return len(text.encode()[:begin].decode()), text.encode()[begin:end].decode()

    tests = _tests_of(file)
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.expr | ast.If | ast.While):
            continue
        for part, new in _changes(node):
            offset, old = segment(part)
            name = f"{file}:{part.lineno} {' '.join(old.split())} -> {' '.join(new.split())}"
            yield Mutant(name, file, old, new, tests, offset)


def _changes(node: ast.AST) -> Iterator[tuple[ast.expr, str]]:
    """Yield parts of an expression or statement, and what each becomes."""
    match node:
        case ast.Constant(value=float(value)):
            yield node, repr(2.0 * value if value else 1.0)
            yield node, repr(0.5 * value if value else -1.0)
        case ast.Constant(value=int(value)) if not isinstance(value, bool) and value > 2:
            yield node, repr(2 * value)
            yield node, repr(value // 2)
        case ast.Compare(ops=[operator]):
            for table in (_WIDER, _TURNED):
                if type(operator) in table:
                    left, right = ast.unparse(node.left), ast.unparse(node.comparators[0])
                    yield node, f"({left} {table[type(operator)]} {right})"
        case ast.BoolOp():
            for k in range(len(node.values)):
                left_out = [ast.unparse(v) for i, v in enumerate(node.values) if i != k]
                sign = " and " if isinstance(node.op, ast.And) else " or "
                yield node, f"({sign.join(left_out)})"
        case ast.BinOp() if type(node.op) in _OPERATORS:
            sign = _OPERATORS[type(node.op)]
            yield node, f"({ast.unparse(node.left)} {sign} {ast.unparse(node.right)})"
        case ast.Call(func=ast.Name(id="min" | "max" as name)) if len(node.args) > 1:
            arguments = ", ".join(ast.unparse(a) for a in node.args)
            yield node, f"{'max' if name == 'min' else 'min'}({arguments})"
        case ast.If() | ast.IfExp():
            yield node.test, "True"
            yield node.test, "False"


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.InspectLoader):
    """Loads one module from a text, and no other."""

    def __init__(self, mutant: Mutant) -> None:
        self.name = mutant.file.removesuffix(".py").replace("/", ".")
        self.path, self.text = SOURCE / mutant.file, mutant.source()

    def find_spec(self, fullname, path, target=None):
        if fullname != self.name:
            return None
        return importlib.util.spec_from_file_location(fullname, self.path, loader=self)

    def get_source(self, fullname):
        return self.text

    def get_code(self, fullname):
        return compile(self.text, str(self.path), "exec")


def is_survivor(mutant: Mutant | None, tests: tuple[str, ...], seconds: float) -> bool:
    """Return whether all tests pass with a mutant, or without one, in a process of their own."""
    sys.stdout.flush()
    child = os.fork()
    if child:
        return os.waitpid(child, 0)[1] == 0
    status = 1
    with contextlib.suppress(BaseException):
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1), os.dup2(nowhere, 2)
        if mutant is not None:
            sys.meta_path.insert(0, _Finder(mutant))
        import pytest

        paths = [str(ROOT / "tests" / one) for one in tests]
        status = int(pytest.main(["-q", "-x", "-p", "no:cacheprovider", *paths]))
    os._exit(status)


def _seconds_of(tests: tuple[str, ...], known: dict[tuple[str, ...], float]) -> float:
    """Return the processor time that a mutant may take; end the program where the tests fail as they are."""
    if tests not in known:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        if not is_survivor(None, tests, 1e6):
            raise SystemExit(f"tests fail without a mutant: {' '.join(tests)}")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        known[tests] = _MAX_SLOWER * max(after.ru_utime - before.ru_utime, 1.0)
    return known[tests]


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def _run(mutants: list[Mutant], title: str) -> list[Mutant]:
    known: dict[tuple[str, ...], float] = {}
    survivors = []
    started = time.perf_counter()
    for mutant in mutants:
        mutant.source()  # where it does not fit, the program ends here, and no mutant has died
        if is_survivor(mutant, mutant.tests, _seconds_of(mutant.tests, known)):
            survivors.append(mutant)
            _say(f"LIVES  {mutant.name}  (tests/{' tests/'.join(mutant.tests)})")
    seconds = time.perf_counter() - started
    _say(f"{title}: {len(mutants) - len(survivors)} of {len(mutants)} die, {seconds:.0f} s")
    return survivors


def files() -> list[str]:
    """Return the files of the rooms that are mutated, relative to src."""
    found = [path for room in ROOMS for path in sorted((SOURCE / room).rglob("*.py"))]
    return [str(path.relative_to(SOURCE)) for path in found if path.name not in _NO_CODE]


def main() -> None:
    """Run named mutants, then some of each file; exit status 1 where a named one lives."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", help="parts of file names; all by default")
    parser.add_argument("--each", type=int, default=10, help="mutants by rule of each file")
    parser.add_argument("--seed", type=int, default=0, help="which of them")
    arguments = parser.parse_args()
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    sys.dont_write_bytecode = True
    sys.path[:0] = [str(SOURCE), str(ROOT)]
    os.chdir(ROOT)
    import numba  # noqa: F401  loaded once, and not by each process

    chosen = [f for f in files() if not arguments.files or any(p in f for p in arguments.files)]
    named = [m for m in NAMED if not arguments.files or any(p in m.file for p in arguments.files)]
    is_named_alive = bool(_run(named, "named mutants"))
    for file in chosen if arguments.each else []:
        mutants = list(mutants_of(file))
        picked = random.Random(arguments.seed).sample(mutants, min(arguments.each, len(mutants)))
        _run(picked, file)
    raise SystemExit(int(is_named_alive))


if __name__ == "__main__":
    main()
