"""log[i] and slices of every log: the same scans as an iteration gives, found by an index and not by a list."""

from __future__ import annotations

import gzip
import tracemalloc

import numpy as np
import pytest

import curvescan as cs
from curvescan.io import pick_scans
from curvescan.io.log import Log
from tests.bags import scan as bag_scan
from tests.bags import storage, write_bag
from tests.carmen_files import flaser

N = 23
RNG = np.random.default_rng(5)
RANGES = np.round(RNG.uniform(0.5, 5.0, (N, 31)), 3)


def carmen(folder):
    path = folder / "log.clf"
    lines = [line for i in range(N) for line in ("# note", flaser(RANGES[i], stamp=0.1 * i), "FLASER 9 1")]
    path.write_text("\n".join(lines))  # no newline at the end
    return path


def packed(folder):
    path = folder / "log.clf.gz"
    path.write_bytes(gzip.compress(carmen(folder).read_bytes()))
    return path


def csv(folder):
    path = folder / "log.csv"
    lines = ["# by hand", "stamp,ranges"]
    for i in range(N):
        if i % 7 == 0:
            angles = np.linspace(-1.0 - 0.01 * i, 1.0, 31)
            lines.append("angles," + ",".join(map(repr, angles.tolist())))
        if i % 3 == 0:
            lines.append("intensities," + ",".join(map(str, range(i, i + 31))))
        if i % 5 == 0:
            lines.append("nonsense,1,2")
        lines.append(f"{0.1 * i}," + ",".join(map(repr, RANGES[i].tolist())))
    path.write_text("\n".join(lines) + "\n")
    return path


def npz(folder, write=np.savez, order="C"):
    path = folder / "log.npz"
    write(
        path,
        stamps=0.1 * np.arange(N),
        ranges=np.array(RANGES, order=order),
        counts=np.where(np.arange(N) % 4 == 1, 20, 31),
        angle_min=-np.linspace(1.0, 1.2, N),
        angle_increment=0.05,
        intensities=np.arange(N * 31.0).reshape(N, 31),
        range_max=np.where(np.arange(N) == 3, -1.0, 8.0),  # one scan that is skipped
    )
    return path


def coreslam(folder):
    path = folder / "log.dat"
    lines = []
    for i in range(N):
        ranges = (1000 * np.resize(RANGES[i], 682)).astype(int)
        fields = [100_000 * i, 0, 10 * i, 11 * i, *[0] * 20, *ranges, 0]
        lines.append(" ".join(map(str, fields)))
        lines.append("")
    path.write_text("\n".join(lines))
    return path


def bag(kind):
    def make(folder):
        messages = [bag_scan(10**11 + 10**8 * (i // 2), RANGES[i].tolist(), angle_increment=0.05) for i in range(N)]
        return storage(write_bag(folder / "source", kind, messages))

    return make


MAKERS = {
    "carmen": carmen,
    "packed": packed,
    "csv": csv,
    "npz": npz,
    "npz compressed": lambda folder: npz(folder, np.savez_compressed),
    "npz fortran": lambda folder: npz(folder, order="F"),
    "coreslam": coreslam,
    "ros1": bag("ros1"),
    "sqlite3": bag("sqlite3"),
    "mcap": bag("mcap"),
}


def same(a, b):
    assert (a.stamp, a.range_min, a.range_max) == (b.stamp, b.range_min, b.range_max)
    np.testing.assert_array_equal(a.ranges, b.ranges)
    np.testing.assert_array_equal(a.angles, b.angles)
    assert (a.intensities is None) == (b.intensities is None)
    if a.intensities is not None:
        np.testing.assert_array_equal(a.intensities, b.intensities)


@pytest.mark.parametrize("name", MAKERS)
def test_every_log_gives_the_scans_of_its_iteration_by_number(tmp_path, name):
    log = cs.read_log(MAKERS[name](tmp_path))
    scans = list(log)
    assert len(scans) == len(log) >= N - 1
    for i in (0, 3, len(log) - 1, 7, 1, -1, -len(log)):
        same(log[i], scans[i])
    for i in (len(log), -len(log) - 1):
        with pytest.raises(IndexError, match=f"no scan {i}"):
            log[i]
    assert repr(log).startswith(f"Log({log.name!r}: {log.format}, ")
    assert "\n" not in repr(log)


@pytest.mark.parametrize("name", ["carmen", "npz", "sqlite3"])
@pytest.mark.parametrize(
    "part", [slice(3), slice(4, 9), slice(20, None), slice(None, None, 4), slice(9, 2, -3), slice(5, 5)]
)
def test_a_slice_is_a_log(tmp_path, name, part):
    log = cs.read_log(MAKERS[name](tmp_path))
    view = log[part]
    assert isinstance(view, Log)
    expected = list(log)[part]
    assert len(view) == len(expected)
    for a, b in zip(view, expected, strict=True):
        same(a, b)
    if expected:
        same(view[-1], expected[-1])
    same_again = view[::-1]
    for a, b in zip(same_again, expected[::-1], strict=True):
        same(a, b)


def test_a_slice_has_the_odometry_of_its_scans(tmp_path):
    log = cs.read_log(carmen(tmp_path))
    assert log.odometry is not None
    np.testing.assert_array_equal(log[3:9:2].odometry.poses, log.odometry.poses[3:9:2])
    assert log[3:9:2].name == "log.clf[3:9:2]"


def test_a_log_as_its_user_has_set_it_up_gives_the_same_scans_by_number(tmp_path):
    path = npz(tmp_path)
    log = cs.read_log(path, clockwise=True, drop_stale=True, ignore_beams=(2, 1), range_max=4.0)
    for i, scan in enumerate(log):
        same(log[i], scan)


def test_scans_in_memory_and_simulated_ones_are_sliced_too():
    simulated = cs.simulate("office", n_scans=6, seed=1)
    held = cs.log_from_arrays([(float(i), RANGES[i]) for i in range(6)], angle_min=-1.0, angle_increment=0.05)
    for log in (simulated, held):
        same(log[2:][1], list(log)[3])
        assert len(log[1:-1]) == 4
        assert "\n" not in repr(log)
        assert len(repr(log)) < 100


def test_a_scan_of_a_large_file_is_found_without_reading_what_stands_before(tmp_path, monkeypatch):
    path = tmp_path / "large.clf"
    line = flaser(np.full(361, 2.5))
    path.write_text("\n".join(line for _ in range(4000)))
    log = cs.read_log(path)
    parsed = []
    from curvescan.io.carmen import log as reader

    parse = reader.SCAN_PARSERS[b"FLASER"]
    monkeypatch.setitem(reader.SCAN_PARSERS, b"FLASER", lambda line: parsed.append(1) or parse(line))
    tracemalloc.start()
    log[3999], log[2000], log[-1]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(parsed) == 3
    assert peak < 300_000  # a scan, and not the 7 MB of the file


def test_scans_are_picked_in_the_order_given(tmp_path):
    log = cs.read_log(carmen(tmp_path))
    for scan, i in zip(pick_scans(log, (7, 2, 7)), (7, 2, 7), strict=True):
        same(scan, log[i])
    with pytest.raises(cs.InvalidArgumentError, match="there is no scan 23"):
        pick_scans(log, (23,))


def test_a_file_that_changed_is_told(tmp_path):
    path = carmen(tmp_path)
    log = cs.read_log(path)
    path.write_text("FLASER 1 1\n" * 9)
    with pytest.raises(cs.LogFileError, match="has changed"):
        log[20]
