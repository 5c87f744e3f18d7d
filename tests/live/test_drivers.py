"""An LD19 is emulated on a pseudo terminal, and everything that can go wrong with it is done to it."""

import itertools
import math
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from curvescan import InvalidArgumentError, Odometry, SourceError, simulate
from curvescan.live import ScanSource, Tracker, run_live
from curvescan.live.drivers import open_driver, transport
from curvescan.live.drivers.lds2d_source import Lds2dSource
from curvescan.live.drivers.transport import TurnClock, scan_of_turn
from curvescan.live.live_map import warm_up

pytest.importorskip("serial", reason="pyserial is not installed (extra lidar)")
pytest.importorskip("lds2d", reason="lds2d is not installed (extra lidar)")
if sys.platform == "win32":
    pytest.skip("there are no pseudo terminals", allow_module_level=True)

from tests.live.ld19 import Ld19, turn_packets

RATE = 50.0  # turns a second: five times the sensor's, so that tests are short


@pytest.fixture
def ld19():
    laser = Ld19()
    yield laser
    laser.unplug()


def drive(n):
    return list(simulate("office", sensor="spinning-360", n_scans=n, seed=3))


def taken(source, n):
    with source:
        return list(itertools.islice(source.scans(), n))


def test_a_driver_is_a_source(ld19):
    assert isinstance(open_driver("lds2d:LDROBOT-LD19", ld19.port), ScanSource)


@pytest.mark.slow
def test_none_of_600_turns_is_lost_and_poses_are_right(ld19, record_property):
    n, rate = 600, 20.0  # twice the sensor's pace, so that the test takes half a minute
    scans = drive(n)
    rng = np.random.default_rng(0)
    turns = [turn_packets(scan, rate, rng.uniform(0.0, 0.7)) for scan in scans]
    turns.append(turns[-1][:1])  # the last turn ends when the next begins
    read, latencies = [], []

    def on_scan(tracked):
        latencies.append(time.time() - (tracked.scan.stamp + tracked.scan.scan_time))
        read.append(tracked)

    warm_up(Odometry)

    class Powered(Lds2dSource):
        """A laser that is switched on when its port is open, and unplugged at the end."""

        def __enter__(self):
            super().__enter__()
            ld19.play(turns, 1.0 / rate)
            threading.Thread(target=lambda: (ld19.wait(), ld19.unplug()), daemon=True).start()
            return self

    source = Powered("LDROBOT-LD19", ld19.port)
    # what a busy machine delays waits here: that the driver loses nothing is what is tested
    report = run_live(source, Tracker(Odometry()), is_lossless=True, on_scan=on_scan)
    assert "is gone" in str(report.error)
    # the first turn is cut: a sensor is switched on anywhere
    assert report.n_scans == n - 1
    assert {len(tracked.scan) for tracked in read} == {456}
    reference = Odometry()
    sent = [reference.add(scan) for scan in scans[1:]]
    # metres, radians: rounded to mm, angles moved by up to 0.7 deg, and taken for a sweep that takes its time
    motions = np.array([t.step.motion - s.motion for t, s in zip(read, sent, strict=True)])
    assert np.abs(motions).max() < 0.05
    end = read[-1].step.pose - sent[-1].pose
    assert np.hypot(*end[:2]) < 0.6  # after 25 m
    stamps = np.array([tracked.scan.stamp for tracked in read])
    assert np.all(np.diff(stamps) > 0.0)
    assert np.median(np.diff(stamps)) == pytest.approx(1.0 / rate, rel=0.1)
    median, worst = 1e3 * np.median(latencies), 1e3 * np.max(latencies)
    record_property("end of turn to pose, ms", f"{median:.1f} median, {worst:.1f} worst")
    assert median < 50.0


def test_turns_that_come_late_keep_their_time():
    period, jitter = 0.1, 0.003
    rng = np.random.default_rng(1)
    ends = period * np.arange(1, 200)
    arrivals = ends + rng.uniform(0.0, jitter, ends.size)
    late = arrivals.copy()
    late[50:52] = arrivals[52]  # two turns are held back and come with the third
    clock = TurnClock()
    stamped = np.array([clock.turn(t, 1.0 / period)[1] for t in late])
    assert np.abs(stamped - ends).max() < 0.01
    # by arrival alone they would be two turns late
    assert np.abs(late - ends).max() > 0.15


def test_a_gap_that_stays_is_kept():
    clock = TurnClock()
    ends = 0.1 * np.arange(1, 100)
    ends[40:] += 0.7
    stamped = np.array([clock.turn(t, 10.0)[1] for t in ends])
    assert np.abs(stamped[60:] - ends[60:]).max() < 0.01
    assert np.all(np.diff(stamped) > 0.0)


def test_late_turns_through_the_driver(ld19):
    n, rate = 25, 10.0  # the sensor's own pace: what a busy machine delays is little of a turn
    turns = [turn_packets(scan, rate) for scan in drive(n)]
    ld19.play(turns, 1.0 / rate, held=range(15, 17))
    scans = taken(open_driver("lds2d:LDROBOT-LD19", ld19.port), n - 2)
    stamps = np.diff([scan.stamp for scan in scans])
    assert len(scans) == n - 2
    assert stamps.min() > 0.3 / rate
    assert stamps.max() < 2.5 / rate


def test_unplugged(ld19):
    ld19.play([turn_packets(scan, RATE) for scan in drive(20)], 1.0 / RATE)
    threading.Timer(0.3, ld19.unplug).start()
    with pytest.raises(SourceError, match="is gone"):
        taken(open_driver("lds2d:LDROBOT-LD19", ld19.port), 1000)


def test_silent(ld19, monkeypatch):
    monkeypatch.setattr(transport, "SILENCE", 0.3)
    with pytest.raises(SourceError, match="is the laser powered"):
        taken(open_driver("lds2d:LDROBOT-LD19", ld19.port), 1)


def test_wrong_baud_rate(ld19, monkeypatch):
    monkeypatch.setattr(transport, "NONSENSE", 0.3)
    rng = np.random.default_rng(2)
    ld19.play([[rng.bytes(200) for _ in range(10)] for _ in range(100)], 0.02)
    with pytest.raises(SourceError, match="is 230400 its baud rate"):
        taken(open_driver("lds2d:LDROBOT-LD19", ld19.port), 1)


def test_garbage_between_packets_costs_packets_and_no_more(ld19):
    n = 40
    turns = [turn_packets(scan, RATE) for scan in drive(n)]
    for k in range(5, n, 5):
        broken = bytearray(turns[k][10])
        broken[20] ^= 0xFF
        turns[k][10] = bytes(broken) + b"\x54\x2c\x00garbage"
    ld19.play(turns, 1.0 / RATE)
    scans = taken(open_driver("lds2d:LDROBOT-LD19", ld19.port), n - 2)
    counts = np.array([len(scan) for scan in scans])
    assert np.median(counts) == 456
    assert counts.min() >= 456 - 24  # the broken packet, and one that the garbage took with it


def test_a_port_that_is_not_there():
    with pytest.raises(SourceError, match="is it plugged in"):
        taken(open_driver("lds2d:LDROBOT-LD19", "/dev/no-such-port"), 1)


def test_closing_from_another_thread_ends_the_scans(ld19):
    source = open_driver("lds2d:LDROBOT-LD19", ld19.port)
    with source:
        threading.Timer(0.2, source.__exit__, (None, None, None)).start()
        assert list(source.scans()) == []


def test_a_recording_ends(tmp_path):
    scans = drive(6)
    path = tmp_path / "ld19.bin"
    path.write_bytes(b"".join(b"".join(turn_packets(scan, 10.0)) for scan in scans))
    read = taken(open_driver("lds2d:LDROBOT-LD19", f"recording://{path}"), 100)
    assert len(read) == 4  # the first turn is cut, the last has no end
    assert np.diff([scan.stamp for scan in read]) == pytest.approx(0.1)
    # what it saw is what the simulated sensor saw, mirrored and rounded on the way
    expected = scans[1]
    steps = np.mod(-expected.angles, 2.0 * np.pi) * len(read[0]) / (2.0 * np.pi)
    nearest = read[0].ranges[np.rint(steps).astype(int) % len(read[0])]
    both = expected.valid & (nearest > 0.0)
    assert np.median(np.abs(nearest - expected.ranges)[both]) < 0.02
    with pytest.raises(SourceError, match="cannot read the recording"):
        taken(open_driver("lds2d:LDROBOT-LD19", "recording:///no/such/file"), 1)


def test_over_a_socket():
    import socket

    server = socket.create_server(("127.0.0.1", 0))
    packets = b"".join(b"".join(turn_packets(scan, 10.0)) for scan in drive(6))

    def serve():
        connection, _ = server.accept()
        connection.sendall(packets)
        time.sleep(0.3)
        connection.close()

    threading.Thread(target=serve, daemon=True).start()
    port = f"socket://127.0.0.1:{server.getsockname()[1]}"
    read = []
    with pytest.raises(SourceError, match="is gone"), open_driver("lds2d:LDROBOT-LD19", port) as source:
        read.extend(source.scans())
    server.close()
    assert len(read) <= 4


@pytest.mark.parametrize("driver", ["lds2d", "nothing", "rplidar:A1", ""])
def test_unknown_drivers(driver):
    with pytest.raises(InvalidArgumentError, match="there is no driver"):
        open_driver(driver, "/dev/null")


def test_unknown_models():
    with pytest.raises(InvalidArgumentError, match="did you mean LDROBOT-LD19"):
        open_driver("lds2d:LDROBT-LD19", "/dev/null")


def test_a_turn_as_a_scan():
    degrees = [0.2, 90.0, 180.0, 180.0, 270.0, 359.9]
    points = [(math.radians(d), r, 7.0 * r) for d, r in zip(degrees, [1, 2, 3, 9, 4, 5], strict=True)]
    scan = scan_of_turn(points, 1.0, 2.0, is_clockwise=True, limits=(0.1, 10.0))
    assert scan.angles.tolist() == pytest.approx(np.radians([-0.2, -90, -180, -270, -359.9]).tolist())
    assert scan.ranges.tolist() == [1, 2, 3, 4, 5]
    assert scan.stamp == 1.0
    assert scan.time_increment == pytest.approx(0.2)
    assert scan.intensities.tolist() == [7, 14, 21, 28, 35]
    assert scan_of_turn([(0.0, 1.0, 1.0)], 0, 1, is_clockwise=True, limits=(0, 9)) is None


@pytest.mark.parametrize("ignored", [(0, 150), (0, 200), (150, 0), (80, 80)])
def test_a_turn_of_which_all_is_ignored_is_no_scan(ignored):
    points = [(0.01 * k, 1.0, 1.0) for k in range(150)]
    assert scan_of_turn(points, 0, 1, is_clockwise=False, limits=(0.1, 9.0), ignore_beams=ignored) is None


def n_open_files():
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="no /proc to count open files in")
def test_nothing_is_left_open(ld19):
    before = n_open_files()
    for _ in range(3):
        with open_driver("lds2d:LDROBOT-LD19", ld19.port):
            pass
    assert n_open_files() == before
