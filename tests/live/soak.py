"""A long run, `python tests/live/soak.py HOURS [SPEED] [odometry]`: 720 beams at 40 Hz, a browser, memory, latency.

One lap of a simulated floor is made beforehand and driven again and again, so that what is timed is the run and not the
simulation. Prints the scans and what was dropped, memory after each tenth, and latencies.
"""

from __future__ import annotations

import itertools
import json
import multiprocessing
import resource
import sys
import time
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np

from curvescan import LaserScan, Odometry, Slam
from curvescan.live import LogSource, SimulatedSource, Tracker, Viewer, run_live
from curvescan.live.live_map import warm_up
from curvescan.live.server import PageServer
from curvescan.simulation import SENSORS

RATE = 40.0
SENSOR = replace(
    SENSORS["spinning-360"], name="spinning-720", n_beams=720, angle_increment=np.radians(0.5), period=1.0 / RATE
)


class Laps:
    """A lap of scans, again and again, with stamps that go on; a Log as far as LogSource needs one."""

    def __init__(self, n_scans: int) -> None:
        source = SimulatedSource(sensor=SENSOR, speed=0)
        n_lap = min(len(source.lap()), n_scans)
        with SimulatedSource(sensor=SENSOR, n_scans=n_lap, speed=0) as made:
            self._lap = [scan.ranges for scan in made.scans()]
        self._n, self.name = n_scans, f"{n_scans / RATE / 3600:.2f} h at {RATE:g} Hz"

    def __iter__(self):
        for k, ranges in zip(range(self._n), itertools.cycle(self._lap), strict=False):
            yield LaserScan(
                ranges,
                angle_min=SENSOR.angle_min,
                angle_increment=SENSOR.angle_increment,
                range_min=SENSOR.range_min,
                range_max=SENSOR.range_max,
                stamp=k / RATE,
            )


def listen(url: str, result) -> None:
    """Read the stream as a browser does, in a process of its own; the clock is the machine's."""
    latencies = []
    with urllib.request.urlopen(url + "events", timeout=60) as stream:
        for line in stream:
            if line.startswith(b'data: {"index"'):
                latencies.append(time.monotonic() - json.loads(line[6:])["received"])
            elif b'"kind":"ended"' in line:
                break
    result.put(np.array(latencies))


def memory_mib() -> float:
    """Resident memory of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def main() -> None:
    hours, speed = float(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else 0.0
    mode = "odometry" if "odometry" in sys.argv else "SLAM"
    engine_class = Odometry if mode == "odometry" else Slam
    log = Laps(round(3600 * hours * RATE))
    warm_up(engine_class)
    viewer = Viewer(log.name, mode=mode, is_lossless=True)
    engine, result = engine_class(), multiprocessing.get_context("spawn").Queue()
    step, started = max(log._n // 10, 1), time.monotonic()

    def on_scan(tracked) -> None:
        if tracked.index % step == 0:
            seconds = time.monotonic() - started
            print(f"{tracked.index:>8,} scans, {seconds:6.0f} s, {memory_mib():6.0f} MiB, {engine!r}", flush=True)

    with PageServer(viewer) as server:
        listener = multiprocessing.get_context("spawn").Process(target=listen, args=(server.url, result))
        listener.start()
        time.sleep(3.0)
        report = run_live(LogSource(log, speed=speed), Tracker(engine), [viewer], on_scan=on_scan)
        viewer.close()
        viewer.set_status("ended", "over")
        latencies = result.get(timeout=60)
    print(f"{report.n_scans:,} of {log._n:,} scans, {report.n_dropped} dropped, {memory_mib():.0f} MiB")
    for what, values in (("scan to pose", report.latencies), ("scan to browser", latencies)):
        median, p99, worst = np.percentile(1e3 * values, [50.0, 99.0, 100.0])
        print(f"{what}: {median:.1f} ms median, {p99:.1f} ms p99, {worst:.0f} ms worst of {len(values):,}")
    listener.join()


if __name__ == "__main__":
    main()
