"""Odometry, SLAM or localization over a whole log."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from curvescan.odometry import Odometry
from curvescan.odometry.run import PlacedScan, RunRecord, in_turn, record_steps
from curvescan.odometry.step import Step
from curvescan.scan import LaserScan
from curvescan.slam.localizer import Localizer
from curvescan.slam.loop_search import Beside
from curvescan.slam.slam import Slam
from curvescan.types import Pose

if TYPE_CHECKING:
    from curvescan.runs.odometry_process import OdometryProcess

Engine: TypeAlias = Odometry | Slam | Localizer
"""What has ``add(scan, odometry_pose) -> Step``."""


def odometry_of(engine: Engine) -> Odometry:
    """Return the odometry of an engine, which may be it itself."""
    return engine if isinstance(engine, Odometry) else engine.odometry


def is_deskewed(engine: Engine) -> bool:
    """Return whether an engine deskews sweeps by the times of their beams, as a map of them must then do too."""
    return odometry_of(engine).config.deskew


def run_engine(
    scans: Iterable[LaserScan],
    engine: Engine,
    *,
    odometry_poses: Pose | None = None,
    on_step: Callable[[Step], None] | None = None,
    ahead: OdometryProcess | None = None,
    keeps_steps: bool = True,
) -> RunRecord:
    """Return the record of an engine over a sequence of scans; Ctrl-C ends it and keeps the results so far.

    odometry_poses (n, 3); ahead: The odometry of these scans, begun with ``engine.odometry``, for SLAM alone.
    """
    if isinstance(engine, Slam):
        placed = in_turn(engine.odometry, scans, odometry_poses) if ahead is None else ahead
        source = _closing_loops(engine, placed)
    else:
        source = in_turn(engine, scans, odometry_poses)
    record = record_steps(
        source, engine.method, has_prior=odometry_poses is not None, on_step=on_step, keeps_steps=keeps_steps
    )
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
