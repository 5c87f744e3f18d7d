"""Set-up shared by all tests: real data, markers."""

from __future__ import annotations

import functools
import inspect
import os
from pathlib import Path
from types import CodeType, FunctionType, ModuleType

import pytest
from hypothesis import settings
from numba.core.registry import CPUDispatcher

from curvescan import _jit

# compiling a kernel is no fault of an example, and a suite that fails must fail again
settings.register_profile("curvescan", deadline=None, derandomize=True)
settings.load_profile("curvescan")

ROOT = Path(__file__).resolve().parent.parent


os.environ.setdefault("MPLBACKEND", "Agg")

# what runs the tests side by side says 80, which is nobody's terminal
os.environ.pop("COLUMNS", None)


@functools.cache
def _kernels() -> set[object]:
    return {getattr(one, "py_func", one) for one in _jit._kernels}


@functools.cache
def _homes() -> frozenset[str]:
    """Modules that have kernels."""
    return frozenset(one.__module__ for one in _kernels())


def meets_kernels(function: object) -> bool:
    """Whether a test, or a helper of the tests that it calls, names a kernel, a module of kernels, or a slow twin."""
    waiting, seen = [function], set()
    while waiting:
        one = waiting.pop()
        one = getattr(getattr(one, "hypothesis", None), "inner_test", one)
        one = inspect.unwrap(getattr(one, "py_func", one))
        if one in seen:
            continue
        seen.add(one)
        if one in _kernels() or str(getattr(one, "__module__", "")).startswith("tests.reference"):
            return True
        if isinstance(one, ModuleType):
            if one.__name__ in _homes() or one.__name__.startswith("tests.reference"):
                return True
        elif isinstance(one, FunctionType) and one.__module__.startswith("tests."):
            names = _names(one.__code__)
            waiting += [value for name, value in one.__globals__.items() if name in names and _is_code(value)]
    return False


def _is_code(value: object) -> bool:
    return isinstance(value, ModuleType | FunctionType | CPUDispatcher)


def _names(code: CodeType) -> set[str]:
    inner = (one for one in code.co_consts if isinstance(one, CodeType))
    return {*code.co_names}.union(*map(_names, inner))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if isinstance(item, pytest.Function) and meets_kernels(item.obj):
            item.add_marker("kernels")
    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "1":
        return
    skip = pytest.mark.skip(reason="runs compiled only")
    for item in items:
        if "slow" in item.keywords:
            item.add_marker(skip)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of the real logs: CURVESCAN_DATA, or shared/data beside the checkout."""
    folder = Path(os.environ.get("CURVESCAN_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real logs at {folder}: set CURVESCAN_DATA to their folder")
    return folder
