"""Arguments that several commands take."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field, fields, replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import numpy as np
import tyro

from curvescan.errors import InvalidArgumentError, require
from curvescan.io import SensorSetup
from curvescan.mapping.config import OccupancyConfig
from curvescan.matchers.baselines.config import CoxConfig, HistogramConfig, IcpConfig, IdcConfig, PlIcpConfig
from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.registry import DEFAULT_METHOD, MatcherConfig, Method
from curvescan.odometry.config import OdometryConfig
from curvescan.slam.config import SlamConfig

if TYPE_CHECKING:
    from curvescan.io import Log
    from curvescan.runs.batch.jobs import LogOptions
    from curvescan.types import Floats

LogPath: TypeAlias = Annotated[
    tyro.conf.Positional[Path],
    tyro.conf.arg(
        metavar="LOG",
        help="The log: CARMEN, a ROS bag (ROS 1, ROS 2 sqlite3, MCAP), CSV, NPZ or CoreSLAM, plain or gzip-compressed; "
        "or a ROS 2 bag's folder.",
    ),
]

OutFolder: TypeAlias = Annotated[
    Path | None, tyro.conf.arg(help="Results folder; by default ./NAME-COMMAND, numbered.")
]


def results_folder(out: Path | None, log: Path, what: str) -> Path:
    """Return where results go: `out`, or the first of ./NAME-WHAT, ./NAME-WHAT-2, ... that is not there."""
    if out is not None:
        return out
    stem = log.resolve().name.split(".")[0] or "log"
    names = (f"{stem}-{what}" + (f"-{k}" if k > 1 else "") for k in count(1))
    return next(Path(name) for name in names if not Path(name).exists())


WorldName: TypeAlias = Literal[
    "room", "corridor", "bare-corridor", "round-room", "l-hall", "t-hall", "curved-hall", "clutter", "office",
    "building", "office-floor",
]  # fmt: skip
SensorName: TypeAlias = Literal["sick-lms200", "sick-lms200-5mm", "spinning-360", "urg-04lx", "hokuyo-270"]
BenchmarkName: TypeAlias = Literal[
    "aces", "intel", "mit-killian-court", "mit-csail", "freiburg-079", "freiburg-hospital"
]
"""Names of tables of the library, written out so that -h loads none of them."""

MethodName: TypeAlias = Annotated[Method, tyro.conf.arg(help="The matcher.")]  # which matcher

MapFile: TypeAlias = Annotated[
    Path, tyro.conf.arg(metavar="FILE", help="The map: map.csmap of `curvescan slam`, or map.yaml.")
]

Chain: TypeAlias = Literal["auto", "keys", "last"]
"""What a scan is matched with: keyframes, the last scan, or what suits the method."""

ConfigFile: TypeAlias = Annotated[
    Path | None,
    tyro.conf.arg(
        metavar="FILE",
        help="TOML file of parameters, one table a method, as `curvescan calibrate` writes it. Flags override it.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class MatcherFlags:
    """The matcher, and parameters of every one; those of the method that runs are used."""

    method: MethodName = "curvescan"
    config: ConfigFile = None
    curvescan: CurvescanConfig = field(default_factory=CurvescanConfig)
    """The default matcher."""
    cfsma: CfSmaConfig = field(default_factory=CfSmaConfig)
    """CF-SMA (Núñez et al. 2009)."""
    idc: IdcConfig = field(default_factory=IdcConfig)
    """Iterative dual correspondence (Lu and Milios 1997)."""
    cox: CoxConfig = field(default_factory=CoxConfig)
    """Points to lines (Cox 1991)."""
    histogram: HistogramConfig = field(default_factory=HistogramConfig)
    """Angle, x and y histograms (Weiss and v. Puttkamer 1995)."""
    icp: IcpConfig = field(default_factory=IcpConfig)
    """Point to point ICP (Besl and McKay 1992); needs SciPy."""
    plicp: PlIcpConfig = field(default_factory=PlIcpConfig)
    """Point to line ICP (Censi 2008)."""

    @property
    def matcher(self) -> MatcherConfig:
        """Parameters of the method."""
        config: MatcherConfig = getattr(self, self.method)
        return config


Matching: TypeAlias = Annotated[MatcherFlags, tyro.conf.arg(name="")]
"""The matcher, as flags --method, --config and --METHOD.PARAMETER."""


@dataclass(frozen=True, kw_only=True)
class OdometryFlags:
    """The matcher and the odometry."""

    matching: Matching = MatcherFlags()
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    """Keyframes, the motion model, and their gates."""

    def config(self, chain: Chain = "auto") -> OdometryConfig:
        """Return the configuration of the odometry; "auto" uses keyframes where they suit the matcher."""
        uses_keys = chain == "keys" or (chain == "auto" and self.matching.method == DEFAULT_METHOD)
        config = self.odometry if uses_keys else OdometryConfig.scan_to_scan()
        return replace(config, deskew=self.odometry.deskew)


@dataclass(frozen=True, kw_only=True)
class SlamFlags:
    """The matcher, and SLAM or localization."""

    matching: Matching = MatcherFlags()
    slam: SlamConfig = field(default_factory=SlamConfig)
    """Keyframes, loop closures, the optimizer, and the odometry in front."""


OdometryRules: TypeAlias = Annotated[OdometryFlags, tyro.conf.arg(name="")]
SlamRules: TypeAlias = Annotated[SlamFlags, tyro.conf.arg(name="")]

MapConfig: TypeAlias = Annotated[OccupancyConfig, tyro.conf.arg(name="map", help="How to make the occupancy map.")]
"""Parameters of the occupancy map, as flags --map.PARAMETER."""

LaserPose: TypeAlias = Annotated[tuple[float, float, float], tyro.conf.arg(metavar="X Y YAW_DEG")]
"""Pose of the laser on the robot: metres, metres, degrees."""


def in_radians(laser_pose: tuple[float, float, float]) -> Floats:
    """Return a pose given in metres and degrees as the library has it."""
    require(all(map(math.isfinite, laser_pose)), "a laser pose must be finite", laser_pose)
    x, y, yaw_deg = laser_pose
    return np.array([x, y, math.radians(yaw_deg)])


Flag: TypeAlias = Annotated[bool, tyro.conf.FlagCreatePairsOff]  # given or not


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How the log is read, and how the laser is set up where its log does not say so or is wrong."""

    range_max: float | None = None
    """Upper limit of a valid reading, metres, in place of what the log says."""
    topic: str | None = None
    """Topic of a ROS bag to read, if the bag holds laser scans on several."""
    rig: Flag = False
    """Join all lasers of a ROS bag into one at the robot's base; the bag's transforms give their mounts."""
    ignore_beams: Annotated[tuple[int, int], tyro.conf.arg(metavar="FIRST LAST")] = (0, 0)
    """Numbers of beams to ignore at the beginning and at the end of each sweep, as they see the robot."""
    laser_pose: Annotated[tuple[float, float, float] | None, tyro.conf.arg(metavar="X Y YAW_DEG")] = None
    """Pose of the laser on the robot, metres, metres, degrees, in place of the log's. It carries the wheel odometry to
    the laser."""
    upside_down: Flag = False
    """The laser hangs upside down, though the log does not say so: mirror its scans."""
    upright: Flag = False
    """The laser stands upright, though the log says that it hangs upside down: do not mirror its scans."""
    clockwise: Flag = False
    """The laser turns against what the log says: mirror its scans."""
    drop_stale: Flag = False
    """Ignore a reading that repeats the last one of its beam to the last digit: it was not measured again."""
    backwards: Flag = False
    """Reverse the beams of each scan: the log lists them against the order of the sweep, as some RPLIDAR drivers do."""

    def __post_init__(self) -> None:
        if self.upside_down and self.upright:
            raise InvalidArgumentError("--upside-down and --upright exclude each other: give one")
        if self.rig and replace(self, rig=False) != Reading():
            raise InvalidArgumentError("--rig takes the lasers as the bag has them: give no other flag of the reading")

    def setup(self) -> SensorSetup:
        """Return how the laser is set up, as the library has it."""
        pose: Any = None if self.laser_pose is None else tuple(in_radians(self.laser_pose).tolist())
        hangs = self.upside_down if self.upside_down or self.upright else None
        alike = ("ignore_beams", "clockwise", "drop_stale", "backwards")
        return SensorSetup(laser_pose=pose, upside_down=hangs, **{name: getattr(self, name) for name in alike})

    def logs(self) -> LogOptions:
        """Return how logs are opened, as the library has it."""
        from curvescan.runs.batch.jobs import LogOptions

        return LogOptions(range_max=self.range_max, topic=self.topic, rig=self.rig, setup=self.setup())

    def open(self, path: Path) -> Log:
        """Return the log that the flags ask for."""
        return self.logs().open(path)


ReadingFlags: TypeAlias = Annotated[Reading, tyro.conf.arg(name="", help="How the log is read.")]


@dataclass(frozen=True, kw_only=True)
class Preparation:
    """What of a log is used, and what is mended in it."""

    as_is: Flag = False
    """Mend nothing: take codes for no return, stale, mirrored or reversed beams as the log has them."""
    laser_only: Flag = False
    """Ignore wheels and gyroscope, even where they agree with the scans."""
    odometry_prior: Flag = False
    """Use the motion of the log's wheel odometry or gyroscope, even where it disagrees with the scans."""

    def __post_init__(self) -> None:
        if self.odometry_prior and self.laser_only:
            raise InvalidArgumentError("--odometry-prior and --laser-only exclude each other: give one")

    @property
    def wanted(self) -> bool | None:
        """Whether the motion prior of the log is used: None where it agrees with the scans."""
        return True if self.odometry_prior else False if self.laser_only else None


@dataclass(frozen=True, kw_only=True)
class LogFlags:
    """How a log is read, what of it is used, and what is mended in it."""

    preparation: Annotated[
        Preparation, tyro.conf.arg(name="", help="What of a log is used, and what is mended in it.")
    ] = Preparation()
    reading: ReadingFlags = Reading()

    def options(self, matching: MatcherFlags) -> dict[str, Any]:
        """Return what runs of all kinds are told alike."""
        wanted, as_is = self.preparation.wanted, self.preparation.as_is
        shared = {"method": matching.method, "matcher": matching.matcher, "command": tuple(sys.argv)}
        return {**shared, "odometry_prior": wanted, "as_is": as_is}


LogUse: TypeAlias = Annotated[LogFlags, tyro.conf.arg(name="")]
"""How a log is read and what of it is used, as flags of their own."""


def config_tables() -> dict[str, object]:
    """Return the tables that a file given with --config may have, by name, with their defaults."""
    methods = MatcherFlags()
    tables = {f.name: getattr(methods, f.name) for f in fields(methods) if f.name not in ("method", "config")}
    return {**tables, "odometry": OdometryConfig(), "slam": SlamConfig(), "map": OccupancyConfig()}
