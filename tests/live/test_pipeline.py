"""Source -> tracker -> sinks: live equals offline to the bit, a slow sink delays nobody, a fault keeps what came before."""

import itertools
import threading
import time

import numpy as np
import pytest

from curvescan import InvalidArgumentError, Odometry, SourceError, read_log, simulate
from curvescan.live import (
    BoundedQueue,
    LiveSink,
    LogSource,
    McapRecorder,
    ResultsSink,
    ScanSource,
    SimulatedSource,
    Tracker,
    Viewer,
    run_live,
)
from curvescan.live.sinks import WorkerSink
from curvescan.odometry import run_odometry


@pytest.fixture(scope="module")
def log():
    return simulate("office", sensor="spinning-360", n_scans=60, seed=1)


class Faulty(LogSource):
    """A laser that goes after twenty scans."""

    is_live = True

    def scans(self):
        yield from itertools.islice(super().scans(), 20)
        raise SourceError("the laser is gone")


class Slow(WorkerSink):
    """A sink that takes half a second a scan."""

    def _take(self, tracked):
        time.sleep(0.5)


def test_the_sources_are_sources(log):
    assert isinstance(LogSource(log), ScanSource)
    assert isinstance(SimulatedSource(), ScanSource)


def test_live_equals_offline_to_the_bit(log):
    tracked = []
    report = run_live(LogSource(log, speed=0), Tracker(Odometry()), on_scan=tracked.append)
    offline = run_odometry(log)
    assert report.n_scans == len(log)
    assert report.n_dropped == 0
    assert np.array_equal([t.pose for t in tracked], offline.trajectory.poses)
    assert np.array_equal([t.covariance for t in tracked], offline.trajectory.covariances)
    assert [t.outcome for t in tracked] == list(offline.outcomes)


def test_a_slow_sink_delays_nobody(log):
    sink = Slow("slow", capacity=5)
    started = time.monotonic()
    run_live(LogSource(log, speed=0), Tracker(Odometry()), [sink])
    assert time.monotonic() - started < 0.5 * len(log) / 3
    assert sink.n_dropped >= len(log) - 5 - 20


def test_a_fault_of_the_source_keeps_what_came_before(log):
    report = run_live(Faulty(log, speed=0), Tracker(Odometry()), is_lossless=True)
    assert report.n_scans == 20
    assert str(report.error) == "the laser is gone"
    assert not report.is_interrupted


def test_a_live_source_is_never_kept_waiting(log):
    class Laser(LogSource):
        is_live = True

    class Slowly(Odometry):
        def add(self, scan, odometry_pose=None):
            time.sleep(0.02)
            return super().add(scan, odometry_pose)

    report = run_live(Laser(log, speed=0), Tracker(Slowly()))
    assert report.n_dropped > 0
    assert report.n_scans + report.n_dropped == len(log)


def test_an_interrupt_ends_the_run_and_keeps_it(log):
    tracked = []

    def on_scan(item):
        tracked.append(item)
        if len(tracked) == 10:
            raise KeyboardInterrupt

    report = run_live(LogSource(log, speed=0), Tracker(Odometry()), on_scan=on_scan)
    assert report.is_interrupted
    assert report.n_scans == 10


@pytest.mark.parametrize("speed", [1.0, 20.0])
def test_a_replay_keeps_the_pace_of_its_stamps(log, speed):
    n = 4 if speed == 1.0 else 40
    started = time.monotonic()
    with LogSource(log, speed=speed) as source:
        scans = list(itertools.islice(source.scans(), n))
    took = time.monotonic() - started
    assert took >= (scans[-1].stamp - scans[0].stamp) / speed - 1e-3
    with pytest.raises(InvalidArgumentError, match="speed"):
        LogSource(log, speed=-1.0)


def test_closing_a_source_ends_its_scans(log):
    source = LogSource(log, speed=0.01)
    threading.Timer(0.2, source.__exit__, (None, None, None)).start()
    with source:
        assert len(list(source.scans())) < 3


def test_the_simulated_robot_drives_on_and_is_the_same_again():
    one, two = (SimulatedSource(n_scans=5, seed=4, speed=0) for _ in range(2))
    for a, b in zip(one.scans(), two.scans(), strict=True):
        assert np.array_equal(a.ranges, b.ranges, equal_nan=True)
    lap = one.lap()
    assert np.hypot(*(lap[-1] - lap[0])[:2]) < 0.2  # metres: lap after lap without a leap


def test_a_queue_drops_the_oldest_or_waits():
    lossy = BoundedQueue(3)
    for k in range(10):
        assert lossy.put(k)
    assert [lossy.get() for _ in range(3)] == [7, 8, 9]
    assert lossy.n_dropped == 7
    assert lossy.get(timeout=0.01) is None

    lossless = BoundedQueue(3, is_lossless=True)
    threading.Thread(
        target=lambda: [lossless.put(k) for k in range(100)] + [lossless.close()]
    ).start()
    assert list(iter(lossless.get, None)) == list(range(100))
    assert lossless.n_dropped == 0
    assert not lossless.put(1)


def test_a_recording_is_read_again(log, tmp_path):
    path = tmp_path / "run.mcap"
    recorder = McapRecorder(path, is_lossless=True)
    assert isinstance(recorder, LiveSink)
    run_live(LogSource(log, speed=0), Tracker(Odometry()), [recorder])
    assert not path.exists()  # it appears whole
    recorder.close()
    again = read_log(path)
    assert len(again) == len(log)
    for a, b in zip(again, log, strict=True):
        assert np.array_equal(a.ranges, b.ranges.astype(np.float32), equal_nan=True)
    assert np.allclose(again.odometry.poses, run_odometry(log).trajectory.poses, atol=1e-9)


def test_the_results_folder(log, tmp_path):
    sink = ResultsSink(is_lossless=True)
    report = run_live(LogSource(log, speed=0), Tracker(Odometry()), [sink])
    sink.close()
    files = sink.write(tmp_path, report, name="a test")
    assert {file.name for file in tmp_path.iterdir()} == set(files)
    lines = (tmp_path / "trajectory.tum").read_text().splitlines()
    assert len(lines) == len(log)
    assert (tmp_path / "map.pgm").read_bytes().startswith(b"P5\n")


def test_the_viewer_keeps_no_scan_and_draws_the_map(log):
    viewer = Viewer("a test", is_lossless=True)
    run_live(LogSource(log, speed=0), Tracker(Odometry()), [viewer])
    viewer.close()
    assert viewer.picture.png.startswith(b"\x89PNG")
    viewer.stop()
    events = dict(viewer.events())
    assert list(events) == ["about", "status", "path", "map", "scan"]
    assert events["scan"]["index"] == len(log) - 1
    first, last = events["path"]["points"][:2], events["path"]["points"][-2:]
    assert first == [0.0, 0.0]
    assert np.hypot(*(np.array(last) - events["scan"]["pose"][:2])) < 0.05
