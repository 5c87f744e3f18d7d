"""RPLIDAR and Hokuyo are emulated byte by byte, behind the packages that talk to them."""

import itertools
import sys
import threading
import time

import numpy as np
import pytest

from curvescan import MissingPackageError, Odometry, SourceError, simulate
from curvescan.live import ScanSource, Tracker, run_live
from curvescan.live.drivers import open_driver, transport

pytest.importorskip("rplidar", reason="rplidar-roboticia is not installed (extra lidar)")
pytest.importorskip("hokuyolx", reason="hokuyolx is not installed (extra lidar)")
if sys.platform == "win32":
    pytest.skip("there are no pseudo terminals", allow_module_level=True)

from tests.live.rplidar_a1 import RplidarA1, turn_bytes
from tests.live.ust10lx import N_STEPS, Ust10lx

PERIOD = 0.05


@pytest.fixture(scope="module")
def drive():
    return list(simulate("office", sensor="spinning-360", n_scans=60, seed=3))


@pytest.fixture
def plugged():
    lasers = []

    def plug(kind, *args, **kwargs):
        lasers.append(kind(*args, **kwargs))
        return lasers[-1]

    yield plug
    for laser in lasers:
        laser.unplug()


def rplidar(plugged, drive, **kwargs):
    # a turn ends when the next one begins
    turns = [turn_bytes(scan) for scan in drive] + [turn_bytes(drive[-1])[:5]]
    return plugged(RplidarA1, turns, PERIOD, **kwargs)


def taken(source, n):
    with source:
        return list(itertools.islice(source.scans(), n))


def assert_right(read, sent):
    """Poses of what was read are those of what was sent, and its stamps go on."""
    online, reference = Odometry(), Odometry()
    for scan, original in zip(read, sent, strict=True):
        error = np.abs(online.add(scan).pose - reference.add(original).pose)
        assert error.max() < 0.05  # metres, radians: rounded, and seen by other beams
    steps = np.diff([scan.stamp for scan in read])
    assert steps.min() > 0.0
    assert np.median(steps) == pytest.approx(PERIOD, rel=0.1)


@pytest.mark.slow
def test_rplidar_loses_no_turn(plugged, drive):
    laser = rplidar(plugged, drive)
    source = open_driver("rplidar", laser.port)
    assert isinstance(source, ScanSource)
    read = taken(source, len(drive) - 1)
    assert {len(scan) for scan in read} == {360}
    assert_right(read, drive[1:])
    assert laser.commands[:4] == [0x25, 0xF0, 0x52, 0x20]  # stop, motor, health, scan


def test_rplidar_two_turns_late(plugged, drive):
    laser = rplidar(plugged, drive[:30], held=range(12, 14))
    scans = taken(open_driver("rplidar", laser.port), 28)
    steps = np.diff([scan.stamp for scan in scans])
    assert steps.min() > 0.0
    assert steps.max() < 3.5 * PERIOD


def test_rplidar_unplugged(plugged, drive):
    laser = rplidar(plugged, drive)
    threading.Timer(0.5, laser.unplug).start()
    with pytest.raises(SourceError, match="is gone"):
        taken(open_driver("rplidar", laser.port), 1000)


def test_rplidar_silent(plugged, monkeypatch):
    monkeypatch.setattr(transport, "SILENCE", 0.3)
    laser = plugged(RplidarA1, [], PERIOD)
    with pytest.raises(SourceError, match="is the laser powered"):
        taken(open_driver("rplidar", laser.port), 1)


def test_rplidar_wrong_baud_rate(plugged, monkeypatch):
    monkeypatch.setattr(transport, "NONSENSE", 0.5)
    rng = np.random.default_rng(2)
    laser = plugged(RplidarA1, [rng.bytes(500) for _ in range(100)], 0.02)
    with pytest.raises(SourceError, match=r"cannot read|is 115200 its baud rate"):
        taken(open_driver("rplidar", laser.port), 1)


def test_rplidar_garbage_is_a_sentence(plugged, drive):
    turns = [turn_bytes(scan) for scan in drive[:20]]
    turns[10] = turns[10][:500] + b"\x54\x2c\x00garbage" + turns[10][500:]
    laser = plugged(RplidarA1, turns, PERIOD)
    with pytest.raises(SourceError, match="sends what its driver cannot read"):
        taken(open_driver("rplidar", laser.port), 1000)


@pytest.mark.slow
def test_hokuyo_loses_no_sweep(plugged, drive):
    laser = plugged(Ust10lx, drive, PERIOD)
    source = open_driver("hokuyo", laser.port)
    assert isinstance(source, ScanSource)
    read = taken(source, len(drive))
    assert {len(scan) for scan in read} == {N_STEPS}
    assert read[0].angle_min == pytest.approx(np.radians(-135.0))
    assert np.isnan(read[0].ranges).sum() == (~drive[0].valid).sum() or not drive[0].valid.all()
    steps = np.diff([scan.stamp for scan in read])
    assert steps.min() > 0.0


def test_hokuyo_two_sweeps_late(plugged, drive):
    """They come in one piece with the third: the package alone takes them for one reply, and gives up."""
    laser = plugged(Ust10lx, drive[:30], PERIOD, held=range(12, 14))
    scans = taken(open_driver("hokuyo", laser.port), 30)
    assert len(scans) == 30
    assert np.diff([scan.stamp for scan in scans]).min() > 0.0


def test_hokuyo_ignores_all_beams_where_it_has_no_more(plugged, drive):
    laser = plugged(Ust10lx, drive[:3], PERIOD)
    [scan] = taken(open_driver("hokuyo", laser.port, ignore_beams=(0, N_STEPS + 100)), 1)
    assert not scan.valid.any()


def test_hokuyo_unplugged(plugged, drive):
    laser = plugged(Ust10lx, drive, PERIOD)
    threading.Timer(0.5, laser.unplug).start()
    report = run_live(open_driver("hokuyo", laser.port), Tracker(Odometry()))
    assert report.n_scans >= 1
    assert "is gone" in str(report.error)


def test_hokuyo_silent(plugged, monkeypatch):
    monkeypatch.setattr("curvescan.live.drivers.hokuyo_source.SILENCE", 0.3)
    laser = plugged(Ust10lx, [], PERIOD)
    started = time.monotonic()
    with pytest.raises(SourceError, match="timeout"):
        taken(open_driver("hokuyo", laser.port), 1)
    assert time.monotonic() - started < 5.0


def test_hokuyo_garbage_is_a_sentence(plugged, drive, monkeypatch):
    monkeypatch.setattr("tests.live.ust10lx.sweep_text", lambda *_: b"nonsense\n\n")
    laser = plugged(Ust10lx, drive, PERIOD)
    with pytest.raises(SourceError, match="cannot read"):
        taken(open_driver("hokuyo", laser.port), 1)


def test_hokuyo_not_there():
    with pytest.raises(SourceError, match="cannot open"):
        taken(open_driver("hokuyo", "127.0.0.1:1"), 1)


@pytest.mark.parametrize(("driver", "package"), [("rplidar", "rplidar"), ("hokuyo", "hokuyolx")])
def test_without_the_package(driver, package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingPackageError, match=r"curvescan\[lidar\]"):
        open_driver(driver, "127.0.0.1:1")
