"""Live: a source of scans -> odometry or SLAM -> sinks. Names are loaded on first use, so that --help loads no kernel.

The source runs in a thread of its own, the tracker in the caller's, each sink in one of its own: nothing that is slow
to draw or to write delays a pose.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from curvescan.live.foxglove import FoxgloveSink
    from curvescan.live.pipeline import LiveReport, run_live
    from curvescan.live.queues import BoundedQueue
    from curvescan.live.recorder import McapRecorder
    from curvescan.live.results import ResultsSink
    from curvescan.live.sinks import LiveSink
    from curvescan.live.sources import LogSource, ScanSource, SimulatedSource
    from curvescan.live.tracker import TrackedScan, Tracker
    from curvescan.live.viewer import Viewer

_HOMES = {
    "BoundedQueue": "queues",
    "FoxgloveSink": "foxglove",
    "LiveReport": "pipeline",
    "LiveSink": "sinks",
    "LogSource": "sources",
    "McapRecorder": "recorder",
    "ResultsSink": "results",
    "ScanSource": "sources",
    "SimulatedSource": "sources",
    "TrackedScan": "tracker",
    "Tracker": "tracker",
    "Viewer": "viewer",
    "run_live": "pipeline",
}

__all__ = [
    "BoundedQueue",
    "FoxgloveSink",
    "LiveReport",
    "LiveSink",
    "LogSource",
    "McapRecorder",
    "ResultsSink",
    "ScanSource",
    "SimulatedSource",
    "TrackedScan",
    "Tracker",
    "Viewer",
    "run_live",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'curvescan.live' has no attribute {name!r}")
    return getattr(importlib.import_module(f"curvescan.live.{_HOMES[name]}"), name)
