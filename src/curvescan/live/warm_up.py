"""warm_up: compile every kernel before a robot waits for it, by running an engine over a short simulated drive."""

import time
from collections.abc import Callable
from dataclasses import replace

import curvescan
from curvescan._compilation import watch
from curvescan.live.live_map import LiveMap, picture_of
from curvescan.live.tracker import Tracker
from curvescan.matchers import DEFAULT_METHOD
from curvescan.simulation.recording import simulate
from curvescan.simulation.sensing.sensors import SENSORS
from curvescan.slam.run import Engine

_N_SCANS = 20

_SENSOR = replace(SENSORS["spinning-360"], time_increment=1e-4)  # whose sweeps take time


def warm_up(new_engine: Callable[[], Engine], method: str = DEFAULT_METHOD) -> float:
    """Compile every kernel from a scan to a map before a source is opened, so that no scan waits; return seconds."""
    started = time.perf_counter()
    with watch.held():
        curvescan.warm_up(method)
        # what is no kernel takes its time too when it is called first: a short drive with a leap
        scans = list(simulate("office", sensor=_SENSOR, n_scans=_N_SCANS, path="home", radius=2.0))
        tracker, picture = Tracker(new_engine()), LiveMap(is_revisable=True)
        for scan in (*scans, *scans[:3]):
            picture.add(tracker.add(scan))
        picture.redraw()
        picture_of(picture.grid(), 0)
    return time.perf_counter() - started
