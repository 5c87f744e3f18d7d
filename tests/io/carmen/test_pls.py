"""The times of the beams of a SICK PLS, known by its readings."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from curvescan.io.carmen.log import CarmenLog
from tests.carmen_files import configured, flaser, write

N_SWEEPS = 100
BEFORE = 0.01
"""Metres by which a PLS's steps lie beside whole ones in the logs there are."""


def sweeps(step: float, end: float, *, line=flaser) -> str:
    rng = np.random.default_rng(0)
    ranges = np.round(rng.uniform(1.0, end, (N_SWEEPS, 180)) / step) * step + BEFORE
    rows = np.minimum(ranges + 0.01 * (rng.random(ranges.shape) < 0.15), end)
    return "\n".join(line(row.round(2).tolist()) for row in rows)


def test_half_a_turn_of_a_pls_takes_20_ms(tmp_path: Path) -> None:
    scan = CarmenLog(write(tmp_path / "a.log", sweeps(0.05, 50.0)))[0]
    assert scan.time_increment * math.pi / scan.angle_increment == pytest.approx(0.02)


@pytest.mark.parametrize(("step", "end"), [(0.01, 50.0), (0.05, 81.83)], ids=["counts centimetres", "sees farther"])
def test_another_laser_has_no_beam_times(tmp_path: Path, step: float, end: float) -> None:
    assert CarmenLog(write(tmp_path / "a.log", sweeps(step, end)))[0].time_increment == 0.0


def test_few_readings_do_not_show_it(tmp_path: Path) -> None:
    lines = sweeps(0.05, 50.0).splitlines(keepends=True)
    assert CarmenLog(write(tmp_path / "a.log", "".join(lines[:5])))[0].time_increment == 0.0


def test_a_laser_that_gives_its_limit_has_none(tmp_path: Path) -> None:
    def line(row: list[float]) -> str:
        return configured(row, max_range=50.0, start=-1.5, fov=3.1, resolution=0.017)

    assert CarmenLog(write(tmp_path / "a.log", sweeps(0.05, 50.0, line=line)))[0].time_increment == 0.0
