"""Scans from .npz files: what NumPy writes, and what somebody else may have put into one."""

from __future__ import annotations

import gzip
import io
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from curvescan.errors import InvalidArgumentError, LogFormatError
from curvescan.io import read_log

N, M = 4, 5
EVEN: dict[str, Any] = {"angle_min": -1.0, "angle_increment": 0.1}


def ranges(**kwargs: Any) -> Any:
    return np.arange(1.0, N * M + 1, **kwargs).reshape(N, M)


def save(path: Path, **arrays: Any) -> Path:
    with path.open("wb") as file:
        np.savez(file, **{"stamps": np.arange(N), "ranges": ranges()} | arrays)
    return path


def test_the_least_that_makes_a_log(tmp_path: Path) -> None:
    log = read_log(save(tmp_path / "a", **EVEN))
    assert (len(log), log.read_errors, log.odometry) == (N, (), None)
    scan = list(log)[2]
    assert (scan.stamp, scan.range_min, scan.range_max) == (2.0, 0.0, np.inf)
    assert scan.ranges.tolist() == [11, 12, 13, 14, 15]
    assert scan.angles.tolist() == pytest.approx([-1.0, -0.9, -0.8, -0.7, -0.6])


def test_numbers_may_be_one_for_all_or_one_a_scan(tmp_path: Path) -> None:
    arrays = {
        "angle_min": np.arange(N) / 10,
        "angle_increment": -0.1,
        "range_min": 0.5,
        "range_max": np.arange(N) + 5,
        "scan_time": 0.1,
        "time_increment": np.full(N, 0.001),
    }
    log = list(read_log(save(tmp_path / "a", **arrays)))
    assert [scan.angle_min for scan in log] == [0.0, 0.1, 0.2, 0.3]
    assert [scan.range_max for scan in log] == [5.0, 6.0, 7.0, 8.0]
    assert {(s.range_min, s.scan_time, s.time_increment) for s in log} == {(0.5, 0.1, 0.001)}


def test_counts_angles_intensities_and_odometry(tmp_path: Path) -> None:
    angles = np.cumsum(np.linspace(0.1, 0.2, M))
    table = np.array([angles, np.full(M, np.nan), angles, angles])
    odometry = np.array([[0, 0, 0], [1, 0, 4], [np.nan] * 3, [2, 0, 0]])
    strength = ranges()
    strength[1] = np.nan
    path = save(tmp_path / "a", counts=[5, 3, 0, 2], angles=table, intensities=strength, odometry=odometry, **EVEN)
    log = read_log(path)
    scans = list(log)
    assert [len(scan) for scan in scans] == [5, 3, 0, 2]
    assert [scan.intensities is None for scan in scans] == [False, True, True, False]
    assert scans[0].angles.tolist() == angles.tolist()
    assert scans[1].angle_increment == 0.1
    assert log.odometry is not None
    np.testing.assert_allclose(log.odometry.poses[1], [1, 0, 4 - 2 * np.pi])
    assert np.isnan(log.odometry.poses[2]).all()


def test_one_row_of_angles_serves_all(tmp_path: Path) -> None:
    angles = np.cumsum(np.linspace(0.1, 0.2, M))
    for scan in read_log(save(tmp_path / "a", angles=angles)):
        assert scan.angles.tolist() == angles.tolist()


@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<i2", "<f2"])
def test_types_of_numbers(tmp_path: Path, dtype: str) -> None:
    for scan in read_log(save(tmp_path / "a", ranges=ranges().astype(dtype), **EVEN)):
        assert scan.ranges.tolist() == [5 * scan.stamp + k for k in range(1, 6)]


@pytest.mark.parametrize("form", ["fortran", "deflated", "gzip", "large blocks"])
def test_forms_of_files(tmp_path: Path, form: str) -> None:
    path = tmp_path / "a"
    if form == "fortran":
        save(path, ranges=np.asfortranarray(ranges()), **EVEN)
    elif form == "deflated":
        with path.open("wb") as file:
            np.savez_compressed(file, stamps=np.arange(N), ranges=ranges(), **EVEN)
    elif form == "gzip":
        packed = gzip.compress(save(tmp_path / "b", **EVEN).read_bytes(), mtime=0)
        path.write_bytes(packed)
    else:
        wide = np.tile(ranges(), (1, 40_000))  # 1.6 MB a row, more than is read at once
        save(path, ranges=wide, angle_min=0.0, angle_increment=1e-5)
    assert [scan.ranges[:M].tolist() for scan in read_log(path)] == ranges().tolist()


@pytest.mark.parametrize(
    ("arrays", "rule"),
    [
        ({"stamps": [0, np.nan, 2, 3]}, "stamp must be finite, got nan"),
        ({"counts": [5, 6, 5, 5]}, "count of beams beyond the row of ranges"),
        ({"range_min": [0, 9, 0, 0], "range_max": 8.0}, "range limits must satisfy"),
        ({"angle_increment": [1, 0, 1, 1]}, "angle_increment must not be 0"),
        ({"angle_increment": [1, 90, 1, 1]}, "angles must be radians"),
    ],
)
def test_broken_scans_are_skipped_and_counted(tmp_path: Path, arrays: dict[str, Any], rule: str) -> None:
    log = read_log(save(tmp_path / "a", **EVEN | arrays))
    assert [scan.stamp for scan in log] == [0, 2, 3]
    (read_error,) = log.read_errors
    assert read_error.rule.startswith(rule)
    assert read_error.first == "scan 2"


@pytest.mark.parametrize(
    ("arrays", "sentence"),
    [
        ({}, "needs arrays 'angle_min' and 'angle_increment', or 'angles'"),
        (EVEN | {"stamps": [0.0]}, r"'stamps' must be of shape \(4,\) beside ranges"),
        (EVEN | {"ranges": np.zeros(3)}, r"'ranges' must be of shape \(scans, beams\), got \(3,\)"),
        (EVEN | {"ranges": np.zeros((2, 2, 2))}, "at most two dimensions"),
        (EVEN | {"odometry": np.zeros((4, 2))}, r"'odometry' must be of shape \(4, 3\)"),
        (EVEN | {"ranges": ranges().astype(complex)}, "plain numbers, got type complex128"),
        (EVEN | {"stamps": np.array(["a"] * 4)}, "plain numbers"),
        (EVEN | {"stamps": np.zeros(0), "ranges": np.zeros((0, 5))}, "without a scan"),
    ],
)
def test_arrays_that_make_no_scans(tmp_path: Path, arrays: dict[str, Any], sentence: str) -> None:
    with pytest.raises(LogFormatError, match=sentence):
        read_log(save(tmp_path / "a", **arrays))


def test_a_saved_map_is_told_from_a_log(tmp_path: Path) -> None:
    with pytest.raises(LogFormatError, match=r"is a saved map, not a log: .*curvescan localize LOG --map"):
        read_log(save(tmp_path / "map.csmap", csmap_version=np.array([3])))


def test_nothing_is_unpickled(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> Any:
            return (pytest.fail, ("unpickled",))

    path = save(tmp_path / "a", notes=np.array([Trap()], dtype=object), **EVEN)
    with pytest.raises(LogFormatError, match="'notes' must hold plain numbers, got type object"):
        read_log(path)


def npy(shape: str, data: bytes = b"", *, descr: str = "'<f8'") -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data


def archive(path: Path, method: int = zipfile.ZIP_STORED, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", method) as file:
        for name, content in members.items():
            file.writestr(f"{name}.npy", content)
    return path


@pytest.mark.parametrize(
    ("member", "sentence"),
    [
        (npy("(1000000000000, 1000)"), "8,000,000,000,000,000 bytes, and has 0"),
        (npy("(-1, -1)", bytes(8)), "at most two dimensions, got"),
        (npy("(2,)", bytes(8)), "16 bytes, and has 8"),
        (npy("(2,)", bytes(24)), "16 bytes, and has 24"),
        (npy("__import__('os')"), "does not begin like one that numpy.savez wrote"),
        (npy("5"), "does not begin like one that numpy.savez wrote"),
        (npy("(1,)", bytes(8), descr="[('a', '<f8')]"), "plain numbers"),
        (b"\x93NUMPY\x03\x00" + bytes(99), "holds no plain numbers"),
        (b"\x93NUM", "does not begin like one that numpy.savez wrote"),
    ],
)
def test_headers_that_lie(tmp_path: Path, member: bytes, sentence: str) -> None:
    with pytest.raises(LogFormatError, match=sentence):
        read_log(archive(tmp_path / "a", stamps=member))


def test_an_archive_that_unpacks_to_very_much(tmp_path: Path) -> None:
    content = npy("(1000, 10000)", bytes(80_000_000))
    path = archive(tmp_path / "a", zipfile.ZIP_DEFLATED, stamps=npy("(0,)"), ranges=content)
    del content
    assert path.stat().st_size < 1 << 20
    tracemalloc.start()
    with pytest.raises(LogFormatError, match="unpacks to more than 64 MiB"):
        read_log(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4 << 20


def test_other_archives(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a", "w") as file:
        file.writestr("stamps.npy", npy("(0,)"))
        file.writestr("evil.exe", b"")
    with pytest.raises(LogFormatError, match=r"holds 'evil.exe', which is no array"):
        read_log(tmp_path / "a")
    with zipfile.ZipFile(tmp_path / "b", "w") as file:
        file.writestr("readme.txt", b"hello")
    with pytest.raises(LogFormatError, match="is a zip archive, not a log"):
        read_log(tmp_path / "b")
    archive(tmp_path / "c", zipfile.ZIP_BZIP2, stamps=npy("(0,)"))
    with pytest.raises(LogFormatError, match="packed in another way"):
        read_log(tmp_path / "c")


def test_damaged_data_deliver_what_stands_before(tmp_path: Path) -> None:
    wide = np.tile(ranges(), (1, 40_000))
    path = save(tmp_path / "a", ranges=wide, angle_min=0.0, angle_increment=1e-5)
    data = bytearray(path.read_bytes())
    at = data.index(b"ranges.npy") + 3_000_000
    data[at] ^= 0xFF  # the archive's check sum finds it at the end of the array
    path.write_bytes(data)
    log = read_log(path)
    assert 0 < len(log) < N
    assert len(list(log)) == len(log)
    assert "damaged from here on" in log.read_errors[0].rule


def test_any_damage_gives_a_log_or_an_error_of_ours(tmp_path: Path) -> None:
    whole = save(tmp_path / "a", **EVEN).read_bytes()
    rng = np.random.default_rng(1)
    n_read = 0
    for k in range(150):
        data = bytearray(whole)
        for at in rng.integers(0, len(data), 1 + 3 * (k % 2)):
            data[at] = rng.integers(256)
        # the table of contents stands at the end: nothing is read of a file that was cut
        end = rng.integers(4, len(data) + 1) if k % 2 else len(data)
        (tmp_path / "b").write_bytes(data[:end])
        try:
            log = read_log(tmp_path / "b")
        except LogFormatError:
            continue
        n_read += 1
        assert len(list(log)) == len(log) > 0
    assert n_read > 10


def test_no_topics_and_another_limit(tmp_path: Path) -> None:
    path = save(tmp_path / "a", range_max=8.0, **EVEN)
    with pytest.raises(InvalidArgumentError, match="NPZ of scans, which has no topics"):
        read_log(path, topic="/scan")
    assert {scan.range_max for scan in read_log(path, range_max=3.0)} == {3.0}


def test_numpy_reads_our_header_check() -> None:
    # the hand-made headers above are NumPy's own form
    values = np.lib.format.read_array(io.BytesIO(npy("(2,)", np.array([1.0, 2.0]).tobytes())))
    assert values.tolist() == [1.0, 2.0]
