"""Set-up shared by all tests: real data, markers."""

from __future__ import annotations

import functools
import os
from pathlib import Path
from types import FunctionType, ModuleType

import pytest
from hypothesis import settings
from numba.core.registry import CPUDispatcher

from curvescan import _jit

# compiling a kernel is no fault of an example, and a suite that fails must fail again
settings.register_profile("curvescan", deadline=None, derandomize=True)
settings.load_profile("curvescan")

ROOT = Path(__file__).resolve().parent.parent


os.environ.setdefault("MPLBACKEND", "Agg")


@functools.cache
def _kernels() -> set[object]:
    return {getattr(one, "py_func", one) for one in _jit._kernels}


@functools.cache
def imports_kernels(module: ModuleType) -> bool:
    """Whether a test file imports a kernel, a module that has kernels, or a slow twin."""
    homes = {one.__module__ for one in _kernels()}
    for value in vars(module).values():
        if isinstance(value, ModuleType):
            name = value.__name__
            if name in homes or name.startswith("tests.reference"):
                return True
        elif isinstance(value, FunctionType | CPUDispatcher) and (
            getattr(value, "py_func", value) in _kernels() or value.__module__.startswith("tests.reference")
        ):
            return True
    return False


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if isinstance(item, pytest.Function) and imports_kernels(item.module):
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
