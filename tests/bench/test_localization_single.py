"""Single scans: they are counted by how much of them the map shows, and drawn where they were taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from curvescan.odometry import StepOutcome
from localization_runs import Checked
from localization_single import draw, lines
from localization_tasks import task_of_floor


def _single(scan: int, shown: float, error_m: float) -> Checked:
    is_found = np.isfinite(error_m)
    return Checked(
        scan=np.array([scan]),
        outcomes=(StepOutcome.FOUND if is_found else StepOutcome.SEARCHING,),
        shown=np.array([shown]),
        error_m=np.array([error_m]),
        error_rad=np.array([0.01 if is_found else np.nan]),
        nees=np.array([2.0 if is_found else np.nan]),
        milliseconds=np.array([10.0]),
        is_matched=np.array([is_found]),
    )


SCANS = [
    _single(0, 0.95, 0.02),
    _single(1, 0.9, np.nan),
    _single(2, 0.7, np.nan),
    _single(3, 0.1, 7.0),
    _single(4, 0.85, 0.04),
]


def test_single_scans_are_counted_by_what_the_map_shows() -> None:
    inside, partly, outside, rest = lines(SCANS)
    assert inside.endswith("in the map: 2 of 3 right (67%), 0 false")
    assert partly.endswith("partly in the map: 0 of 1 right (0%), 0 false")
    assert outside.endswith("outside: 0 of 1 right (0%), 1 false")
    assert "median error 30 mm, NEES 2.0" in rest


@pytest.mark.slow
def test_single_scans_are_drawn(tmp_path: Path) -> None:
    draw(tmp_path / "single.png", task_of_floor(60, n_test=5), SCANS)
    assert (tmp_path / "single.png").read_bytes().startswith(b"\x89PNG")
