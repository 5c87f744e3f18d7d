"""An engine over a whole log."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial

from curvescan._interrupts import stoppable
from curvescan.engines.engine import Engine, PlacedScan, in_turn
from curvescan.engines.odometry_process import OdometryProcess
from curvescan.engines.record import Recorder, RunRecord
from curvescan.odometry import Odometry, Step
from curvescan.scan import LaserScan
from curvescan.slam.loop_search import Beside
from curvescan.slam.slam import Slam
from curvescan.types import Pose


def run_engine(
    scans: Iterable[LaserScan],
    engine: Engine | None = None,
    *,
    odometry_poses: Pose | None = None,
    on_step: Callable[[Step], None] | None = None,
    ahead: OdometryProcess | None = None,
    keeps_steps: bool = False,
) -> RunRecord:
    """Return the record of an engine over a sequence of scans; Ctrl-C ends it and keeps the results so far, as partial.

    engine: A fresh odometry without one; odometry_poses (n, 3); ahead: The odometry of these scans, begun with
    ``engine.odometry``, for SLAM alone.
    """
    engine = engine or Odometry()
    if isinstance(engine, Slam):
        placed = in_turn(engine.odometry, scans, odometry_poses) if ahead is None else ahead
        source = _closing_loops(engine, placed)
    else:
        source = in_turn(engine, scans, odometry_poses)
    recorder = Recorder(keeps_steps=keeps_steps)
    with stoppable() as stop:
        for _, step, seconds in source:
            recorder.add(step, seconds)
            if on_step:
                on_step(step)
            if stop.is_asked:
                break
    record = recorder.record(engine.method, is_partial=stop.is_asked, has_prior=odometry_poses is not None)
    if not isinstance(engine, Slam):
        return record
    if ahead is not None:
        engine.odometry = ahead.odometry
    return finished(record, engine, partial if ahead is None else ahead.call_after)


def finished(record: RunRecord, slam: Slam, beside: Beside = partial) -> RunRecord:
    """Return the record of a run of SLAM with the poses of its graph, which is optimized once more."""
    started = time.perf_counter()
    n = len(record.outcomes)
    revised = (slam.finish(beside) if n else slam.trajectory())[:n]
    seconds = time.perf_counter() - started
    revised = replace(revised, stamps=record.online.stamps)
    return replace(record, trajectory=revised, seconds_to_finish=seconds)


def _closing_loops(slam: Slam, placed: Iterable[PlacedScan]) -> Iterator[PlacedScan]:
    for one in placed:
        started = time.perf_counter()
        step = slam.add_placed(one.scan, one.step)
        yield PlacedScan(one.scan, step, one.seconds + time.perf_counter() - started)
