"""Set-up shared by all tests: real data, markers."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# compiling a kernel is no fault of an example, and a suite that fails must fail again
settings.register_profile("curvescan", deadline=None, derandomize=True)
settings.load_profile("curvescan")

ROOT = Path(__file__).resolve().parent.parent


os.environ.setdefault("MPLBACKEND", "Agg")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
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
