"""A held log: the scans of the log, read once where there is room for them."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.io.log import HeldLog, Log, LogSlice
from tests.carmen_files import flaser

N = 20
RANGES = np.random.default_rng(3).uniform(0.5, 5.0, (N, 61))


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "log.clf"
    path.write_text("\n".join(flaser(row, stamp=0.1 * i) for i, row in enumerate(RANGES)))
    return cs.read_log(path)


class Counting(HeldLog):
    """Counts how often the log itself is gone over."""

    def __init__(self, log, **kwargs):
        super().__init__(_Counted(log), **kwargs)

    @property
    def n_read(self):
        return self._log.n_read


class _Counted:
    def __init__(self, log):
        self._counted, self.n_read = log, 0

    def __getattr__(self, name):
        return getattr(self._counted, name)

    def __len__(self):
        return len(self._counted)

    def __getitem__(self, i):
        return self._counted[i]

    def __iter__(self):
        self.n_read += 1
        return iter(self._counted)


def same(one, other):
    return (
        np.array_equal(one.ranges, other.ranges, equal_nan=True)
        and np.array_equal(one.angles, other.angles)
        and (one.stamp, one.range_max) == (other.stamp, other.range_max)
    )


def test_the_first_whole_iteration_is_the_last_that_reads(log):
    held = Counting(log)
    next(iter(held))  # a part of it holds nothing
    for _ in range(3):
        found = list(held)
        assert len(found) == N
        assert all(same(*pair) for pair in zip(found, log, strict=True))
    assert held.n_read == 2
    assert same(held[3], log[3])
    assert all(same(*pair) for pair in zip(held[2:9:3], log[2:9:3], strict=True))


def test_what_an_iteration_computes_of_a_scan_ends_with_it(log):
    held = HeldLog(log)
    for _ in range(2):
        for scan in held:
            assert "points" not in vars(scan)
            assert scan.points.shape == (61, 2)


@pytest.mark.parametrize("max_bytes", [0, 10_000])
def test_a_log_beyond_the_limit_is_read_anew_each_time(log, max_bytes):
    held = Counting(log, max_bytes=max_bytes)
    for _ in range(3):
        assert all(same(*pair) for pair in zip(held, log, strict=True))
    assert held.n_read == 3
    assert same(held[3], log[3])


def test_the_limit_counts_directions_of_their_own():
    angles = np.linspace(-1.0, 1.0, 500) ** 3
    scans = [cs.LaserScan(np.ones(500), angles=angles + 1e-3 * k) for k in range(9)]
    even = [cs.LaserScan(np.ones(500), angle_min=0.0, angle_increment=0.01) for _ in scans]
    for given, is_held in ((scans, False), (even, True)):
        held = Counting(given, max_bytes=9 * 1200 + 9 * 500 * 8 + 3 * 500 * 8)
        assert [len(list(held)) for _ in range(2)] == [9, 9]
        assert held.n_read == (1 if is_held else 2)


def test_readings_are_held_once(log):
    below = Counting(log)
    list(below)
    above = HeldLog(LogSlice(below, range(N)))
    for _ in range(2):
        assert all(same(*pair) for pair in zip(above, log, strict=True))
    assert below.n_read == 1
    for _ in range(2):
        assert all(same(*pair) for pair in zip(below, log, strict=True))
    assert below.n_read == 3


def test_it_says_of_itself_what_the_log_says(log):
    held = HeldLog(log)
    assert isinstance(held, Log)
    assert held.turned_by_gyro() is None
    assert not held.hangs_upside_down()
    for name in ("name", "format", "read_errors", "tag_counts", "notes"):
        assert getattr(held, name) == getattr(log, name)
    for one, other in ((held.odometry, log.odometry), (held.robot_odometry(), log.robot_odometry())):
        np.testing.assert_array_equal(one.poses, other.poses)
    assert repr(held) == repr(log)
    bare = HeldLog(cs.simulate("room", n_scans=2))
    assert bare.robot_odometry() is None
