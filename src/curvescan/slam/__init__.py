"""A stream of scans in, a globally consistent trajectory and a map out. Names are loaded on first use."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from curvescan.slam.config import SlamConfig
    from curvescan.slam.localizer import Localizer
    from curvescan.slam.loops.audit import Contradiction
    from curvescan.slam.loops.closures import Closure, ClosureOutcome
    from curvescan.slam.map import SlamMap, load_map
    from curvescan.slam.run import run_engine
    from curvescan.slam.slam import Slam

_HOMES = {
    "Closure": "loops.closures",
    "Contradiction": "loops.audit",
    "Localizer": "localizer",
    "Slam": "slam",
    "SlamConfig": "config",
    "SlamMap": "map",
    "ClosureOutcome": "loops.closures",
    "load_map": "map",
    "run_engine": "run",
}

__all__ = [
    "Closure",
    "ClosureOutcome",
    "Contradiction",
    "Localizer",
    "Slam",
    "SlamConfig",
    "SlamMap",
    "load_map",
    "run_engine",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'curvescan.slam' has no attribute {name!r}")
    return getattr(importlib.import_module(f"curvescan.slam.{_HOMES[name]}"), name)
