"""simulate(): a recorded drive with everything known: poses, what each beam met, who walked by."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.configs import counted
from curvescan.errors import InvalidArgumentError, require
from curvescan.io.files.lines import ReadError
from curvescan.io.log import ScanAccess
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.simulation.buildings.catalogue import build_world
from curvescan.simulation.buildings.world import World
from curvescan.simulation.driving.motion import drive_home, drive_route
from curvescan.simulation.driving.pursuit import Drive, OdometryNoise, wheel_odometry
from curvescan.simulation.sensing.people import NOISE, ODOMETRY, PATH, PEOPLE, WORLD, People, child, walk
from curvescan.simulation.sensing.sensors import Sensor, cast_beams, choose_sensor, measure, sight
from curvescan.types import Bools, Floats, Pose

_DEFAULT_SCANS = 200


@dataclass(frozen=True, eq=False, kw_only=True)
class Simulation(ScanAccess):
    """A simulated log (:class:`curvescan.io.log.Log`) with its truth."""

    name: str  # the world's name and the seed
    world: World  # what stands still
    sensor: Sensor  # what measured
    # true pose of the sensor at each scan, at the time of its first beam, world frame. Between two scans it moves at a
    # constant velocity, along an arc
    truth: Trajectory
    odometry: Trajectory | None  # noisy wheel odometry, frame of the first scan
    # (n_scans, n_beams): what the sensor reports: metres, +inf, -inf or NaN as of :func:`curvescan.simulation.measure`
    ranges: Floats
    # (n_scans, n_beams): metres without noise; +inf where nothing stands within reach, which is range_max and a little
    # more (:func:`curvescan.simulation.sensing.sensors.sight`)
    exact_ranges: Floats
    is_person: Bools  # (n_scans, n_beams): which valid readings are of people
    people: Floats  # (n_scans, c, 3): circles [x, y, r] that the walkers showed at each scan, metres, world frame
    format: str = "simulated log"
    read_errors: tuple[ReadError, ...] = ()
    tag_counts: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.ranges)

    def __iter__(self) -> Iterator[LaserScan]:
        return map(self._scan_at, range(len(self)))

    def __repr__(self) -> str:
        return f"Simulation({self.name!r}: {counted(len(self), 'scan')} of {self.sensor.name} in {self.world.name})"

    def _scan_at(self, i: int) -> LaserScan:
        return as_scan(self.ranges[i], self.sensor, float(self.truth.stamps[i]))


def simulate(
    world: World | str = "office",
    *,
    sensor: Sensor | str = "sick-lms200",
    n_scans: int | None = None,
    n_people: int = 0,
    seed: int = 0,
    poses: ArrayLike | None = None,
    drive: Drive | None = None,
    odometry_noise: OdometryNoise | None = OdometryNoise(),  # noqa: B008 - frozen
) -> Simulation:
    """Return the scans of a drive through a world, with the truth about them.

    The world, the path, the noise of each scan, the people and the odometry each have their own seed: adding people
    changes neither the path nor the noise, and a shorter log is the start of a longer one
    (but for ``Drive(path="home")``, which must get home in time).

    Parameters
    ----------
    world : World or str
        A world, or the name of one in :data:`curvescan.simulation.WORLDS`, built with `seed`.
    sensor : Sensor or str
        A sensor, or the name of one in :data:`curvescan.simulation.SENSORS`.
    n_scans : int or None
        How many scans, >= 1. None: as many as `poses`; else one lap of the world's route, or 200 scans.
    n_people : int
        How many people walk around the robot.
    seed : int
        The same seed, the same bits; >= 0.
    poses : (n, 3) array_like or None
        True poses of the sensor, world frame, instead of a drive.
    drive : Drive or None
        Path, speeds and clearance of the robot; None: the defaults.
    odometry_noise : OdometryNoise or None
        None: a log without odometry.

    Raises
    ------
    InvalidArgumentError
        When a name is unknown, a number out of range, or the world has no room for the robot.
    """
    sensor = choose_sensor(sensor)
    require(n_scans is None or n_scans >= 1, "n_scans must be >= 1", n_scans)
    require(n_people >= 0, "n_people must be >= 0", n_people)
    world = build_world(world, child(seed, WORLD))
    if poses is not None:
        truth = _given(poses, n_scans)
    else:
        drive, rng = drive or Drive(), np.random.default_rng(child(seed, PATH))
        if n_scans is None and (drive.path == "home" or len(world.route) < 2):
            n_scans = _DEFAULT_SCANS
        if drive.path == "home" and n_scans is not None:
            truth = drive_home(world, drive, sensor.period, rng, n_scans)
        else:
            truth = drive_route(world, drive, sensor.period, rng, n_scans)
    stamps: Floats = sensor.period * np.arange(len(truth), dtype=np.float64)
    circles = walk(world, truth, n_people, People(), sensor.period, child(seed, PEOPLE))
    ranges, exact, is_person = observe(world, truth, sensor, circles, seed, velocities=sweep_velocities(truth, sensor))
    odometry = None
    if odometry_noise is not None:
        rng = np.random.default_rng(child(seed, ODOMETRY))
        odometry = Trajectory(stamps=stamps, poses=wheel_odometry(truth, odometry_noise, rng))
    return Simulation(
        name=f"{world.name} (seed {seed})",
        world=world,
        sensor=sensor,
        truth=Trajectory(stamps=stamps, poses=truth),
        odometry=odometry,
        ranges=ranges,
        exact_ranges=exact,
        is_person=is_person,
        people=circles,
    )


def sweep_velocities(poses: Pose, sensor: Sensor) -> Floats | None:
    """Return (n, 3) velocities after (n, 3) poses, after the last as before it; None where a sweep takes no time.

    Metres, metres, radians a second, in the sensor's own frame.
    """
    if not sensor.time_increment:
        return None
    steps = se2.log(se2.between(poses[:-1], poses[1:])) / sensor.period
    return np.vstack([steps, steps[-1:] if len(steps) else np.zeros((1, 3))])


def observe(
    world: World,
    poses: Pose,
    sensor: Sensor,
    people: Floats,
    seed: int | np.random.SeedSequence,
    *,
    velocities: Floats | None = None,
) -> tuple[Floats, Floats, Bools]:
    """Return measured ranges, exact ranges and person masks, each (n, n_beams), at (n, 3) poses.

    `people` is (n, c, 3): circles at each pose. `velocities`, (n, 3) in the sensor's frame, m/s and rad/s, are those of
    the sensor during each sweep; None: it stands still.
    """
    # Numba loads when something is cast
    from curvescan.simulation.sensing.raycast import cast_sweep

    shape = (len(poses), sensor.n_beams)
    ranges, exact, is_person = np.empty(shape), np.empty(shape), np.empty(shape, dtype=bool)
    beams: Floats = np.arange(sensor.n_beams, dtype=np.float64)
    angles, times = sensor.angle_min + sensor.angle_increment * beams, sensor.time_increment * beams[:, np.newaxis]
    for i, pose in enumerate(poses):
        if velocities is None:
            exact[i], hit_idx = cast_beams(world, pose, sensor, range_max=sight(sensor), people=people[i])
        else:
            on_the_way = se2.compose(pose, se2.exp(times * velocities[i]))
            exact[i], hit_idx = cast_sweep(world, on_the_way, angles, range_max=sight(sensor), people=people[i])
        ranges[i] = measure(exact[i], sensor, np.random.default_rng(child(seed, NOISE, i)))
        is_person[i] = (hit_idx >= world.n_primitives) & np.isfinite(ranges[i])
    for array in (ranges, exact, is_person):
        array.setflags(write=False)
    return ranges, exact, is_person


def as_scan(ranges: Floats, sensor: Sensor, stamp: float) -> LaserScan:
    """Return measured ranges as a scan of a sensor."""
    return LaserScan(
        ranges,
        angle_min=sensor.angle_min,
        angle_increment=sensor.angle_increment,
        range_min=sensor.range_min,
        range_max=sensor.range_max,
        stamp=stamp,
        time_increment=sensor.time_increment,
        scan_time=sensor.period,
    )


def _given(poses: ArrayLike, n_scans: int | None) -> Pose:
    truth = np.array(poses, dtype=np.float64)
    if truth.ndim != 2 or truth.shape[1] != 3 or not len(truth) or not np.isfinite(truth).all():
        raise InvalidArgumentError(f"poses must be finite, of shape (n, 3) and at least one, got shape {truth.shape}")
    if n_scans is not None and n_scans > len(truth):
        raise InvalidArgumentError(f"n_scans is {n_scans}, but only {len(truth)} poses are given")
    return truth[:n_scans]
