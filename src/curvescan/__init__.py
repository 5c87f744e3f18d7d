"""curvescan: 2D laser scan matching, laser odometry and the tools around them.

Names are loaded on first use (PEP 562): ``import curvescan`` reads no file and imports neither NumPy,
Numba nor Matplotlib.

One rule for configurations: ``method=`` names a matcher, ``config=`` configures what is called (the matcher in
:func:`match`, the odometry in :class:`Odometry` and :func:`run`), and ``matcher=`` configures the matcher within. Each
takes an instance of its config class or a mapping of the fields that differ from the defaults.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from curvescan._version import __version__

if TYPE_CHECKING:
    from curvescan import se2
    from curvescan.diagnostics.inspect import inspect_log
    from curvescan.diagnostics.issues import find_issues
    from curvescan.diagnostics.sensor import odometry_for
    from curvescan.errors import (
        CurvescanError,
        InvalidArgumentError,
        LogFileError,
        LogFormatError,
        MapTooLargeError,
        MissingPackageError,
        OutputError,
        SourceError,
        StorageError,
        UnitWarning,
        WorkerError,
    )
    from curvescan.io import (
        log_from_arrays,
        read_config,
        read_csv,
        read_log,
        read_poses,
        read_relations,
        read_tum,
        write_config,
        write_csv,
        write_log,
        write_tum,
    )
    from curvescan.io.files.read_errors import ReadError
    from curvescan.io.log import Log, LogSlice
    from curvescan.io.ros.writing.odometry_export import write_odometry_mcap
    from curvescan.io.trajectories.g2o import write_g2o
    from curvescan.io.trajectories.kitti import write_kitti
    from curvescan.io.trajectories.trajectory import Trajectory, read_kitti
    from curvescan.mapping.config import OccupancyConfig
    from curvescan.mapping.map_server import write_map
    from curvescan.mapping.occupancy import OccupancyBuilder, OccupancyGrid
    from curvescan.matchers import PreparedScan, match, prepare
    from curvescan.matchers.baselines.config import (
        ConvergenceConfig,
        CoxConfig,
        HistogramConfig,
        IcpConfig,
        IdcConfig,
        LinesConfig,
        PlIcpConfig,
        ShrinkConfig,
    )
    from curvescan.matchers.cfsma.config import (
        CfSmaConfig,
        CurvatureConfig,
        FunctionsConfig,
        LandmarksConfig,
        SegmentationConfig,
    )
    from curvescan.matchers.curvescan.config import (
        CurvescanConfig,
        HypothesesConfig,
        InformationConfig,
        KeypointsConfig,
        RefinementConfig,
        ScoringConfig,
        SegmentsConfig,
    )
    from curvescan.matchers.registry import MATCHERS
    from curvescan.matchers.result import Label, MatchResult, Outcome
    from curvescan.odometry import Odometry, Step, StepOutcome
    from curvescan.odometry.config import KeyframesConfig, MotionConfig, OdometryConfig
    from curvescan.plots import on_axes as plot
    from curvescan.runs.batch.batch import BatchResult, run_batch
    from curvescan.runs.batch.jobs import OdometryJob, SlamJob
    from curvescan.runs.evaluation import evaluate
    from curvescan.runs.result import Run
    from curvescan.runs.run import localize, run
    from curvescan.scan import LaserScan
    from curvescan.simulation import simulate
    from curvescan.slam import Localizer, Slam, SlamConfig, SlamMap, load_map
    from curvescan.types import PoseEdge
    from curvescan.warmup import warm_up

_HOMES = {
    "BatchResult": "curvescan.runs.batch.batch",
    "CfSmaConfig": "curvescan.matchers.cfsma.config",
    "ConvergenceConfig": "curvescan.matchers.baselines.config",
    "CoxConfig": "curvescan.matchers.baselines.config",
    "CurvatureConfig": "curvescan.matchers.cfsma.config",
    "CurvescanConfig": "curvescan.matchers.curvescan.config",
    "CurvescanError": "curvescan.errors",
    "FunctionsConfig": "curvescan.matchers.cfsma.config",
    "HistogramConfig": "curvescan.matchers.baselines.config",
    "HypothesesConfig": "curvescan.matchers.curvescan.config",
    "IcpConfig": "curvescan.matchers.baselines.config",
    "IdcConfig": "curvescan.matchers.baselines.config",
    "InformationConfig": "curvescan.matchers.curvescan.config",
    "InvalidArgumentError": "curvescan.errors",
    "KeyframesConfig": "curvescan.odometry.config",
    "KeypointsConfig": "curvescan.matchers.curvescan.config",
    "Label": "curvescan.matchers.result",
    "LandmarksConfig": "curvescan.matchers.cfsma.config",
    "LaserScan": "curvescan.scan",
    "LinesConfig": "curvescan.matchers.baselines.config",
    "Localizer": "curvescan.slam",
    "Log": "curvescan.io.log",
    "LogFileError": "curvescan.errors",
    "LogFormatError": "curvescan.errors",
    "LogSlice": "curvescan.io.log",
    "MATCHERS": "curvescan.matchers.registry",
    "MapTooLargeError": "curvescan.errors",
    "MatchResult": "curvescan.matchers.result",
    "MissingPackageError": "curvescan.errors",
    "MotionConfig": "curvescan.odometry.config",
    "OccupancyBuilder": "curvescan.mapping.occupancy",
    "OccupancyConfig": "curvescan.mapping.config",
    "OccupancyGrid": "curvescan.mapping.occupancy",
    "Odometry": "curvescan.odometry",
    "OdometryConfig": "curvescan.odometry.config",
    "OdometryJob": "curvescan.runs.batch.jobs",
    "Outcome": "curvescan.matchers.result",
    "OutputError": "curvescan.errors",
    "PlIcpConfig": "curvescan.matchers.baselines.config",
    "PoseEdge": "curvescan.types",
    "PreparedScan": "curvescan.matchers",
    "ReadError": "curvescan.io.files.read_errors",
    "RefinementConfig": "curvescan.matchers.curvescan.config",
    "Run": "curvescan.runs.result",
    "ScoringConfig": "curvescan.matchers.curvescan.config",
    "SegmentationConfig": "curvescan.matchers.cfsma.config",
    "SegmentsConfig": "curvescan.matchers.curvescan.config",
    "ShrinkConfig": "curvescan.matchers.baselines.config",
    "Slam": "curvescan.slam",
    "SlamConfig": "curvescan.slam",
    "SlamJob": "curvescan.runs.batch.jobs",
    "SlamMap": "curvescan.slam",
    "SourceError": "curvescan.errors",
    "StorageError": "curvescan.errors",
    "Step": "curvescan.odometry",
    "StepOutcome": "curvescan.odometry",
    "Trajectory": "curvescan.io.trajectories.trajectory",
    "UnitWarning": "curvescan.errors",
    "WorkerError": "curvescan.errors",
    "evaluate": "curvescan.runs.evaluation",
    "find_issues": "curvescan.diagnostics.issues",
    "inspect_log": "curvescan.diagnostics.inspect",
    "load_map": "curvescan.slam",
    "localize": "curvescan.runs.run",
    "log_from_arrays": "curvescan.io",
    "match": "curvescan.matchers",
    "odometry_for": "curvescan.diagnostics.sensor",
    "prepare": "curvescan.matchers",
    "read_config": "curvescan.io",
    "read_csv": "curvescan.io",
    "read_kitti": "curvescan.io.trajectories.trajectory",
    "read_log": "curvescan.io",
    "read_poses": "curvescan.io",
    "read_relations": "curvescan.io",
    "read_tum": "curvescan.io",
    "run": "curvescan.runs.run",
    "run_batch": "curvescan.runs.batch.batch",
    "simulate": "curvescan.simulation",
    "warm_up": "curvescan.warmup",
    "write_config": "curvescan.io",
    "write_csv": "curvescan.io",
    "write_g2o": "curvescan.io.trajectories.g2o",
    "write_kitti": "curvescan.io.trajectories.kitti",
    "write_log": "curvescan.io",
    "write_map": "curvescan.mapping.map_server",
    "write_odometry_mcap": "curvescan.io.ros.writing.odometry_export",
    "write_tum": "curvescan.io",
}

_MODULES = {"plot": "curvescan.plots.on_axes", "se2": "curvescan.se2"}

__all__ = [
    "MATCHERS",
    "BatchResult",
    "CfSmaConfig",
    "ConvergenceConfig",
    "CoxConfig",
    "CurvatureConfig",
    "CurvescanConfig",
    "CurvescanError",
    "FunctionsConfig",
    "HistogramConfig",
    "HypothesesConfig",
    "IcpConfig",
    "IdcConfig",
    "InformationConfig",
    "InvalidArgumentError",
    "KeyframesConfig",
    "KeypointsConfig",
    "Label",
    "LandmarksConfig",
    "LaserScan",
    "LinesConfig",
    "Localizer",
    "Log",
    "LogFileError",
    "LogFormatError",
    "LogSlice",
    "MapTooLargeError",
    "MatchResult",
    "MissingPackageError",
    "MotionConfig",
    "OccupancyBuilder",
    "OccupancyConfig",
    "OccupancyGrid",
    "Odometry",
    "OdometryConfig",
    "OdometryJob",
    "Outcome",
    "OutputError",
    "PlIcpConfig",
    "PoseEdge",
    "PreparedScan",
    "ReadError",
    "RefinementConfig",
    "Run",
    "ScoringConfig",
    "SegmentationConfig",
    "SegmentsConfig",
    "ShrinkConfig",
    "Slam",
    "SlamConfig",
    "SlamJob",
    "SlamMap",
    "SourceError",
    "Step",
    "StepOutcome",
    "StorageError",
    "Trajectory",
    "UnitWarning",
    "WorkerError",
    "__version__",
    "evaluate",
    "find_issues",
    "inspect_log",
    "load_map",
    "localize",
    "log_from_arrays",
    "match",
    "odometry_for",
    "plot",
    "prepare",
    "read_config",
    "read_csv",
    "read_kitti",
    "read_log",
    "read_poses",
    "read_relations",
    "read_tum",
    "run",
    "run_batch",
    "se2",
    "simulate",
    "warm_up",
    "write_config",
    "write_csv",
    "write_g2o",
    "write_kitti",
    "write_log",
    "write_map",
    "write_odometry_mcap",
    "write_tum",
]


def __getattr__(name: str) -> object:
    if name in _MODULES:
        return importlib.import_module(_MODULES[name])
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'curvescan' has no attribute {name!r}")
    value = getattr(importlib.import_module(home), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
