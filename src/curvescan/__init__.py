"""curvescan: 2D laser scan matching, laser odometry and the tools around them.

Names are loaded on first use (PEP 562): ``import curvescan`` reads no file and imports neither NumPy,
Numba nor Matplotlib.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from curvescan import se2
    from curvescan.errors import (
        CurvescanError,
        InvalidArgumentError,
        LogFileError,
        LogFormatError,
        MissingPackageError,
        OutputError,
        SourceError,
        UnitWarning,
    )
    from curvescan.io import log_from_arrays, read_log, write_log
    from curvescan.mapping.config import OccupancyConfig
    from curvescan.mapping.occupancy import OccupancyBuilder
    from curvescan.matchers import PreparedScan, match, prepare
    from curvescan.matchers.result import MatchResult, Outcome
    from curvescan.odometry import Odometry, OdometryStep, StepOutcome
    from curvescan.scan import LaserScan
    from curvescan.simulation import simulate
    from curvescan.types import Trajectory

_HOMES = {
    "CurvescanError": "curvescan.errors",
    "InvalidArgumentError": "curvescan.errors",
    "LaserScan": "curvescan.scan",
    "LogFileError": "curvescan.errors",
    "LogFormatError": "curvescan.errors",
    "MatchResult": "curvescan.matchers.result",
    "MissingPackageError": "curvescan.errors",
    "OccupancyBuilder": "curvescan.mapping.occupancy",
    "OccupancyConfig": "curvescan.mapping.config",
    "Odometry": "curvescan.odometry",
    "OdometryStep": "curvescan.odometry",
    "Outcome": "curvescan.matchers.result",
    "OutputError": "curvescan.errors",
    "PreparedScan": "curvescan.matchers",
    "SourceError": "curvescan.errors",
    "StepOutcome": "curvescan.odometry",
    "Trajectory": "curvescan.types",
    "UnitWarning": "curvescan.errors",
    "log_from_arrays": "curvescan.io",
    "match": "curvescan.matchers",
    "prepare": "curvescan.matchers",
    "read_log": "curvescan.io",
    "se2": "curvescan",
    "simulate": "curvescan.simulation",
    "write_log": "curvescan.io",
}

__all__ = [
    "CurvescanError",
    "InvalidArgumentError",
    "LaserScan",
    "LogFileError",
    "LogFormatError",
    "MatchResult",
    "MissingPackageError",
    "OccupancyBuilder",
    "OccupancyConfig",
    "Odometry",
    "OdometryStep",
    "Outcome",
    "OutputError",
    "PreparedScan",
    "SourceError",
    "StepOutcome",
    "Trajectory",
    "UnitWarning",
    "__version__",
    "log_from_arrays",
    "match",
    "prepare",
    "read_log",
    "se2",
    "simulate",
    "write_log",
]


def __getattr__(name: str) -> object:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'curvescan' has no attribute {name!r}")
    if home == "curvescan":
        return importlib.import_module(f"curvescan.{name}")
    value = getattr(importlib.import_module(home), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
