"""A stream of scans in, a globally consistent trajectory and a map out. Names are loaded on first use."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from curvescan.slam.config import SlamConfig
    from curvescan.slam.localization.step import LocalizerOutcome, LocalizerStep
    from curvescan.slam.localizer import Localizer
    from curvescan.slam.loops.audit import Contradiction
    from curvescan.slam.loops.closures import Closure, ClosureOutcome
    from curvescan.slam.map import SlamMap, load_map
    from curvescan.slam.run import SlamRun, run_slam
    from curvescan.slam.slam import Slam
    from curvescan.slam.step import SlamStep

_HOMES = {
    "Closure": "loops.closures",
    "Contradiction": "loops.audit",
    "Localizer": "localizer",
    "LocalizerOutcome": "localization.step",
    "LocalizerStep": "localization.step",
    "Slam": "slam",
    "SlamConfig": "config",
    "SlamMap": "map",
    "SlamRun": "run",
    "SlamStep": "step",
    "ClosureOutcome": "loops.closures",
    "load_map": "map",
    "run_slam": "run",
}

__all__ = [
    "Closure",
    "ClosureOutcome",
    "Contradiction",
    "Localizer",
    "LocalizerOutcome",
    "LocalizerStep",
    "Slam",
    "SlamConfig",
    "SlamMap",
    "SlamRun",
    "SlamStep",
    "load_map",
    "run_slam",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'curvescan.slam' has no attribute {name!r}")
    return getattr(importlib.import_module(f"curvescan.slam.{_HOMES[name]}"), name)
