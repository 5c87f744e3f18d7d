"""The jobs of ``curvescan batch``: odometry or SLAM of a log, and what comes of it.

Kernels and figures are loaded when a job runs: a batch that has nothing left to do is over at once.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from curvescan.configs import as_config, as_plain
from curvescan.io.reading import open_log
from curvescan.io.sensor_setup import SensorSetup
from curvescan.mapping.config import OccupancyConfig
from curvescan.matchers.registry import DEFAULT_METHOD, MatcherConfig, config_of
from curvescan.odometry.config import OdometryConfig
from curvescan.slam.config import SlamConfig

if TYPE_CHECKING:
    from curvescan.io.log import Log
    from curvescan.runs.run import EngineName


@dataclass(frozen=True, kw_only=True)
class JobResult:
    """What came of one log."""

    is_trusted: bool  # whether the trajectory can be trusted
    sentence: str  # why, or why not
    n_scans: int  # how many scans it has
    length: float  # length of the path, metres


class Job(Protocol):
    """What a batch does with each log: a frozen dataclass of a module, so that worker processes can be sent it.

    Its fields are the options; by their digest :func:`run_batch` with ``resume=True`` finds which results still stand.
    """

    def __call__(self, log: Path, folder: Path) -> JobResult:
        """Run over a log and write the results into a folder that need not exist; errors are raised."""

    def warm_up(self) -> None:
        """Compile what the job needs, once, before the workers start."""


def digest_of(job: Job) -> str:
    """Return a digest of the kind and the options of a job, 16 hexadecimal digits."""
    kind = type(job)
    parts: tuple[Field[Any], ...] = fields(job) if is_dataclass(job) else ()
    options = {f.name: as_plain(getattr(job, f.name)) for f in parts if f.metadata.get("is_option", True)}
    text = json.dumps([kind.__module__, kind.__qualname__, options], sort_keys=True, default=repr)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True, kw_only=True)
class LogOptions:
    """How each log is opened; as the arguments of :func:`curvescan.read_log`."""

    range_max: float | None = None
    """Upper limit of a valid reading, metres, in place of what the log says."""
    topic: str | None = None
    """Which topic of a ROS bag to read."""
    rig: bool = False
    """Whether to join all lasers of a ROS bag into one; all else is then as the bag has it."""
    setup: SensorSetup = field(default_factory=SensorSetup)
    """How the laser is set up."""

    def open(self, path: Path) -> Log:
        """Return the log in a file."""
        if self.rig:
            from curvescan.engines.rig import Rig

            return Rig.of_bag(path).read(path)
        return open_log(path, range_max=self.range_max, topic=self.topic, setup=self.setup)


@dataclass(frozen=True, kw_only=True)
class _LogJob:
    """What odometry and SLAM of a log share; defaults are filled in, so that the same options have one digest."""

    method: str = DEFAULT_METHOD
    """Name of the matcher."""
    matcher: MatcherConfig | None = None
    """Configuration of the matcher; a mapping of the fields that differ; None for the defaults."""
    config: Any = None
    """Configuration of the engine."""
    odometry_prior: bool | None = None
    """Whether to expect the motion of the log's wheel odometry or gyroscope; None where they agree with the scans."""
    as_is: bool = False
    """Whether to take each log as it is, and mend nothing."""
    occupancy: OccupancyConfig = field(default_factory=OccupancyConfig)
    """How to make the occupancy maps."""
    logs: LogOptions = field(default_factory=LogOptions)
    """How each log is opened."""
    command: tuple[str, ...] = field(default=(), metadata={"is_option": False})
    """The command line behind the batch, for run.json."""

    engine: ClassVar[EngineName]

    def __post_init__(self) -> None:
        default = OdometryConfig.of_method(self.method) if self.engine == "odometry" else SlamConfig()
        matcher = config_of(self.method, self.matcher, name="matcher")
        for name, value in (("matcher", matcher), ("config", as_config(self.config, default))):
            object.__setattr__(self, name, value)  # the only way in a frozen dataclass

    def __call__(self, log: Path, folder: Path) -> JobResult:
        """Run the engine over a log and write all results."""
        from curvescan.evaluation.trajectory_errors import travelled
        from curvescan.runs.run import run

        options = {name: value for name, value in vars(self).items() if name != "logs"}
        # one process: the workers have the cores
        options |= {"source": log, "keeps_steps": False, "n_processes": 1}
        result = run(self.logs.open(log), self.engine, out=folder, **options)
        return JobResult(
            is_trusted=result.verdict.is_trusted,
            sentence=result.verdict.sentence,
            n_scans=len(result.trajectory),
            length=float(travelled(result.trajectory.poses)[-1]),
        )

    def warm_up(self) -> None:
        """Compile the kernels of matcher, odometry, SLAM and maps."""
        from curvescan.warmup import warm_up

        warm_up(self.method)


@dataclass(frozen=True, kw_only=True)
class OdometryJob(_LogJob):
    """Runs the odometry of each log and makes its maps, as :func:`curvescan.run` does."""

    engine = "odometry"
    config: OdometryConfig | Mapping[str, Any] | None = None
    """Configuration of the odometry; a mapping of the fields that differ; None for what suits the method."""


@dataclass(frozen=True, kw_only=True)
class SlamJob(_LogJob):
    """Runs SLAM of each log, as ``curvescan slam`` does."""

    engine = "slam"
    config: SlamConfig | Mapping[str, Any] | None = None
    """Configuration of SLAM; a mapping of the fields that differ; None for the defaults."""
