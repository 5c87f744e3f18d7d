"""Source -> tracker -> sinks: live equals offline, a slow sink delays nobody, a fault keeps what came before."""

import itertools
import json
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from curvescan import InvalidArgumentError, LaserScan, Odometry, Slam, SourceError, read_log, run, se2, simulate
from curvescan.diagnostics.preparation import prepare_log
from curvescan.diagnostics.verdict import judge
from curvescan.engines import run_engine
from curvescan.io.arrays.memory import as_log
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
from curvescan.live import live_map as live_map_module
from curvescan.live.live_map import LiveMap
from curvescan.live.pipeline import finish
from curvescan.live.sinks import WorkerSink
from curvescan.live.sources import MendedSource
from curvescan.simulation.sensing.sensors import SENSORS


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
    offline = run_engine(log)
    assert report.n_scans == len(log)
    assert report.n_dropped == 0
    assert np.array_equal([t.step.pose for t in tracked], offline.trajectory.poses)
    assert np.array_equal([t.step.covariance for t in tracked], offline.trajectory.covariances)
    assert [t.step.outcome for t in tracked] == list(offline.outcomes)


def test_a_slow_sink_delays_nobody(log):
    sink = Slow("slow", capacity=5)
    started = time.monotonic()
    run_live(LogSource(log, speed=0), Tracker(Odometry()), [sink])
    assert time.monotonic() - started < 0.5 * len(log)  # the time the sink would take for all
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
    reasons = judge(report.record_of(len(log)), Odometry(), None).reasons
    assert any("interrupted after 10 scans" in reason for reason in reasons)
    assert not report.record_of(10).is_partial  # of a laser there are no more


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
    threading.Thread(target=lambda: [lossless.put(k) for k in range(100)] + [lossless.close()]).start()
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
    assert np.allclose(again.odometry.poses, run_engine(log).trajectory.poses, atol=1e-9)


def written(log, folder, mode, engine, *, is_replayed):
    """Run live, write the results, and return the folder's files by name."""
    sink = ResultsSink(mode=mode, is_lossless=True)
    tracker = Tracker(engine)
    report = finish(run_live(LogSource(log, speed=0), tracker, [sink]), tracker, [sink])
    sink.close()
    folder.mkdir()
    prepared = prepare_log(log) if is_replayed else None
    files = sink.write(folder, report, name=log.name, engine=engine, log=prepared)
    assert {file.name for file in folder.iterdir()} == set(files)
    return {name: (folder / name).read_bytes() for name in files}


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["odometry", "SLAM"])
def test_the_results_of_a_replay_are_those_of_the_offline_run(log, tmp_path, mode):
    offline = tmp_path / "offline"
    engine = Slam() if mode == "SLAM" else Odometry()
    live = written(log, tmp_path / "live", mode, engine, is_replayed=True)
    run(log, mode.lower(), out=offline)
    assert {file.name for file in offline.iterdir()} == set(live)
    exact = {"trajectory.tum", "trajectory.csv", "map.pgm", "map.yaml", "map.png"}
    if mode == "SLAM":
        exact |= {"trajectory_online.tum", "graph.g2o", "closures.csv", "graph.png"}
    for name in exact:
        assert (offline / name).read_bytes() == live[name], name
    record = json.loads(live["run.json"])
    assert record["scans"] == record["live"]["scans"] == len(log)
    assert record["verdict"]["is_trusted"]
    assert ("slam" in record) == (mode == "SLAM")


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["odometry", "SLAM"])
def test_a_sensor_leaves_the_same_files_though_its_scans_have_gone(log, tmp_path, mode):
    engines = {"odometry": Odometry, "SLAM": Slam}
    replayed, gone = (written(log, tmp_path / str(k), mode, engines[mode](), is_replayed=k == 0) for k in range(2))
    assert replayed.keys() - gone.keys() == {"wheels.png"}  # a sensor has no log with wheels
    assert not gone.keys() - replayed.keys()
    assert replayed["trajectory.tum"] == gone["trajectory.tum"]
    # the map is drawn of fewer scans: what they saw is in the map of all
    one, other = (read_pgm(files["map.pgm"]) for files in (replayed, gone))
    assert other.shape[0] <= one.shape[0] + 2
    assert np.count_nonzero(other == 0) > 0.4 * np.count_nonzero(one == 0)


@pytest.mark.slow
def test_a_running_laser_is_mended_and_judged(log, tmp_path):
    # from beams all around come codes of 15 to 16 m; after 100 scans they are no readings
    rng, told = np.random.default_rng(1), []
    scans = []
    for k in range(240):
        scan = log[min(k % 120, 119 - k % 120)]  # there and back
        is_code = rng.random(len(scan)) < 0.3
        ranges = np.where(is_code, rng.uniform(15.0, 16.0, len(scan)), scan.ranges)
        scans.append(replace(scan, ranges=ranges, range_max=20.0, stamp=0.1 * k))
    seen, sink, engine = [], ResultsSink(is_lossless=True), Odometry()
    source = MendedSource(LogSource(as_log(scans), speed=0), told.append)
    report = run_live(source, Tracker(engine), [sink], is_lossless=True, on_scan=seen.append)
    sink.close()
    assert len(told) == 1
    assert told[0].startswith("from scan 100 on ignored: readings ")
    n_codes = [np.count_nonzero(t.scan.ranges[t.scan.valid] > 14.0) for t in seen]
    assert min(n_codes[:99]) > 50
    assert max(n_codes[99:]) < 20  # those that lie by chance in fours like a surface
    sink.write(tmp_path, report, name="laser", engine=engine)
    verdict = judge(run_engine([t.scan for t in seen]), engine)
    told = json.loads((tmp_path / "run.json").read_text())["verdict"]
    assert (told["is_trusted"], tuple(told["reasons"])) == (verdict.is_trusted, verdict.reasons)


def read_pgm(data):
    """The pixels of a binary PGM; 0 is occupied."""
    _, size, _, pixels = data.split(b"\n", 3)
    columns, rows = map(int, size.split())
    return np.frombuffer(pixels[-rows * columns :], dtype=np.uint8).reshape(rows, columns)


@pytest.mark.slow
def test_memory_follows_the_area_and_not_the_time(log):
    """The same lap twenty times: no more scans are kept than for one, and the newest."""
    tracker, live_map = Tracker(Odometry()), LiveMap(is_revisable=True)
    tracked = [tracker.add(scan) for scan in log]
    for lap in range(20):
        for item in tracked:
            live_map.add(replace(item, index=lap * len(log) + item.index))
        if lap == 0:
            n_kept = len(live_map.kept())
    assert len(live_map.kept()) == n_kept
    assert [index for index, _ in live_map.kept()] == sorted(i for i, _ in live_map.kept())
    assert np.median([index for index, _ in live_map.kept()]) >= 19 * len(log)


def test_what_came_after_revised_poses_stays_on_the_map(log):
    """A redraw may be put off: scans that came meanwhile, and the path there, are not lost with it."""
    tracker, live_map = Tracker(Odometry()), LiveMap(is_revisable=True)
    for scan in log:
        live_map.add(tracker.add(scan))
    kept, path = [index for index, _ in live_map.kept()], live_map.path()
    late = [index for index in kept if index >= 30]
    assert late
    shift = np.array([1.0, 0.0, 0.0])
    live_map.revise(np.array([step.pose for step in run(log, "odometry").steps[:30]]) + shift)
    live_map.redraw()
    assert set(late) <= {index for index, _ in live_map.kept()}
    moved = live_map.path() - path
    assert moved[0] == pytest.approx([1.0, 0.0], abs=1e-9)
    assert moved[-1] == pytest.approx([0.0, 0.0], abs=1e-9)


def gone_astray(log, index):
    """The first scans of a log as they are tracked, of one of them far beyond any map."""
    tracker = Tracker(Odometry())
    tracked = [tracker.add(scan) for scan in itertools.islice(log, 8)]
    far = replace(tracked[index].step, pose=np.array([1e7, 1e7, 0.0]))
    return [*tracked[:index], replace(tracked[index], step=far), *tracked[index + 1 :]]


def test_a_map_that_has_become_too_large_is_told_on_the_page(log):
    viewer = Viewer("laser", is_lossless=True)
    viewer.set_status("running", "running")
    for tracked in gone_astray(log, 5):
        viewer.put(tracked)
    viewer.close()
    kind, text = viewer._status.values()
    assert kind == "running"
    assert text.startswith("The map grows no more: an occupancy map may take 1 GiB")


def test_a_map_that_was_too_large_comes_back_with_revised_poses(log):
    live_map, tracked = LiveMap(is_revisable=True), gone_astray(log, 5)
    for item in tracked:
        live_map.add(item)
    assert live_map.why_no_grid
    live_map.revise(np.array([item.step.pose if k != 5 else tracked[4].step.pose for k, item in enumerate(tracked)]))
    live_map.redraw()
    assert not live_map.why_no_grid
    assert live_map.grid().occupied_centres.size


def test_wheels_that_say_no_place_leave_the_page_alone(log):
    viewer = Viewer("laser")
    tracker = Tracker(Odometry())
    for k, scan in enumerate(itertools.islice(log, 3)):
        viewer.put(tracker.add(scan, odometry_pose=np.array([np.nan, np.nan, 0.01 * k])))
    viewer.close()
    assert viewer._wheels_from is None
    assert not len(viewer._wheels)


def test_a_scan_of_uneven_beams_does_not_end_a_recording(log, tmp_path):
    tracker, path = Tracker(Odometry()), tmp_path / "a.mcap"
    recorder = McapRecorder(path)
    for k, scan in enumerate(itertools.islice(log, 6)):
        tracked = tracker.add(scan)
        uneven = LaserScan(
            scan.ranges, angles=scan.angles - 0.2 * np.linspace(0.0, 1.0, len(scan)) ** 2, stamp=scan.stamp
        )
        recorder.put(replace(tracked, scan=uneven) if k == 2 else tracked)
    recorder.close()
    assert recorder.error is None
    assert (recorder.n_scans, recorder.n_uneven) == (6, 1)
    assert len(read_log(path)) == 5


def test_a_full_disk_ends_a_sink_and_not_the_run():
    class Full(WorkerSink):
        def _take(self, tracked):
            raise OSError(28, "No space left on device")

    sink = Full("recorder", capacity=2, is_lossless=True)
    for _ in range(10):
        sink.put("a scan")
    sink.close()
    assert "recorder ended: No space left on device" in str(sink.error)


def test_a_long_path_is_thinned(log, monkeypatch):
    monkeypatch.setattr(live_map_module, "_MAX_PATH", 20)
    monkeypatch.setattr(live_map_module, "_PATH_STEP_M", 0.001)
    tracker, live_map = Tracker(Odometry()), LiveMap()
    tracked = [tracker.add(scan) for scan in log]
    for item in tracked:
        live_map.add(item)
    assert live_map.path_version > 0
    assert 10 <= live_map.n_path <= 20
    assert np.allclose(live_map.path()[0], [0.0, 0.0])
    gap = np.hypot(*(live_map.path()[-1] - tracked[-1].step.pose[:2]))
    assert gap <= 2.0 * live_map._path_step + 0.05


def test_revised_poses_are_handed_on_once_a_second_at_most(log):
    class Revising(Slam):
        n_trajectories = 0

        def add(self, scan, odometry_pose=None):
            return replace(super().add(scan, odometry_pose), is_revised=True)

        def trajectory(self):
            self.n_trajectories += 1
            return None

    engine = Revising()
    tracker, started = Tracker(engine), time.monotonic()
    for scan in log:
        tracker.add(scan)
    assert 1 <= engine.n_trajectories <= 2 + int(time.monotonic() - started)


def test_the_viewer_keeps_no_scan_and_draws_the_map(log):
    viewer = Viewer("a test", is_lossless=True)
    run_live(LogSource(log, speed=0), Tracker(Odometry()), [viewer])
    viewer.close()
    assert viewer.content("/map.png")[0].startswith(b"\x89PNG")
    viewer.stop()
    events = dict(viewer.events())
    assert list(events) == ["about", "status", "path", "map", "times", "scan"]
    assert events["scan"]["index"] == len(log) - 1
    first, last = events["path"]["points"][:2], events["path"]["points"][-2:]
    assert first == [0.0, 0.0]
    assert np.hypot(*(np.array(last) - events["scan"]["pose"][:2])) < 0.05


def test_a_preview_is_the_first_scan_and_is_not_kept(log):
    viewer, source = Viewer("a test", is_lossless=True), LogSource(log, speed=0)
    viewer.preview(source.first())
    preview = viewer._picture
    assert preview.version == 0
    assert min(preview.shape) > 20  # cells of 0.05 m of what one scan sees
    run_live(source, Tracker(Odometry()), [viewer])
    viewer.close()
    assert viewer._picture.version > 0
    other = Viewer("a test", is_lossless=True)
    run_live(LogSource(log, speed=0), Tracker(Odometry()), [other])
    other.close()
    assert viewer._picture.png == other._picture.png


def test_the_sweeps_of_a_simulated_robot_are_bent_as_a_laser_that_turns_bends_them():
    sensor = SENSORS["spinning-360"]
    source = SimulatedSource(sensor=replace(sensor, time_increment=sensor.period / sensor.n_beams), n_scans=40, speed=0)
    odometry, lap = Odometry(), source.lap()
    poses = np.array([odometry.add(scan).pose for scan in source.scans()])
    n = len(poses)
    middle = se2.compose(lap[:n], se2.exp(0.5 * se2.log(se2.between(lap[:n], lap[1 : n + 1]))))  # of each sweep
    assert np.hypot(*(poses - se2.between(middle[0], middle))[:, :2].T).max() < 0.015


def test_what_a_source_begins_with():
    source = SimulatedSource(n_scans=2, speed=0)
    np.testing.assert_array_equal(source.first().ranges, next(source.scans()).ranges)
    assert LogSource(as_log([])).first() is None


def test_at_the_end_the_sensor_is_where_the_final_map_has_it(log):
    viewer = Viewer("a test", mode="SLAM", is_lossless=True)
    run_live(LogSource(log, speed=0), Tracker(Odometry()), [viewer])
    poses = np.add(run_engine(log).trajectory.poses, [1.0, 2.0, 0.0])
    viewer.finish_with(poses)
    viewer.close()
    viewer.stop()
    events = dict(viewer.events())
    assert events["scan"]["pose"] == pytest.approx(poses[-1].tolist(), abs=1e-4)
    assert events["path"]["points"][:2] == [1.0, 2.0]
