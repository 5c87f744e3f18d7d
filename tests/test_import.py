"""What an import costs: names load on first use, kernels and figures later still."""

from __future__ import annotations

import subprocess
import sys

import pytest

import curvescan


def loaded_after(statement):
    code = f"import sys; {statement}; print(' '.join(m.partition('.')[0] for m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=600)
    return set(done.stdout.split())


def test_import_loads_none_of_the_heavy_packages():
    loaded = loaded_after("import curvescan")
    assert not loaded & {"numpy", "numba", "matplotlib", "rich", "tyro"}


def test_a_scan_needs_numpy_alone():
    loaded = loaded_after("import curvescan; curvescan.LaserScan([1.0], angle_min=0, angle_increment=1).points")
    assert "numpy" in loaded
    assert not loaded & {"numba", "matplotlib"}


def test_a_match_needs_no_matplotlib():
    loaded = loaded_after(
        "import curvescan; s = curvescan.LaserScan([1.0], angle_min=0, angle_increment=1);curvescan.match(s, s)"
    )
    assert not loaded & {"matplotlib", "rich", "tyro"}


def test_every_public_name_loads_and_is_listed():
    for name in curvescan.__all__:
        assert getattr(curvescan, name) is not None
    assert dir(curvescan) == sorted(curvescan.__all__)
    with pytest.raises(AttributeError, match="scan_matcher"):
        curvescan.scan_matcher  # noqa: B018
