"""Warm-up: a simulated drive through two rooms compiles every kernel of a real one, here or for another machine."""

import gc
import os
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from curvescan._compilation import watch
from curvescan._processes import python_command
from curvescan.engines import run_engine
from curvescan.errors import InvalidArgumentError, OutputError
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.run_maps import build_maps
from curvescan.matchers import DEFAULT_METHOD, find_matcher, match
from curvescan.odometry import Odometry, OdometryConfig
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import eigen3
from curvescan.types import Pose

Processor: TypeAlias = Literal["generic", "native"]
"""For which processor code is made: any of the kind of this one (6 % slower, the same results), or this one alone."""

_N_BEAMS, _RANGE_MAX_M, _PERIOD_S, _RADIUS_M = 360, 5.0, 0.1, 0.3
_N_LAP = 10  # scans of a lap on a circle

_ROOM = ((-2.0, 2.5, -1.5, 1.8), (-1.0, 1.2, -1.0, 4.0))
"""Rooms are two rectangles that the sensor stands in, x and y of their walls in metres: here an L with corners."""

_HALL = ((-50.0, 50.0, -1.0, 1.0), (-50.0, 50.0, -1.0, 1.0))
"""Two walls without an end: a direction is unobservable, and nothing is shared with the room."""


def warm_up(
    method: str = DEFAULT_METHOD,
    *,
    slam: bool = True,
    cache: str | os.PathLike[str] | None = None,
    processor: Processor = "generic",
) -> float:
    """Compile all kernels that matching, odometry, SLAM and maps need, or load them from the cache.

    The first match of a process does the same for itself, piece by piece, when it may be least welcome: a robot that
    drives calls this before it starts its motors. Nothing is read or written but the cache of the kernels. Objects that
    are there when it ends are left out of Python's later garbage collections (:func:`gc.freeze`).

    Parameters
    ----------
    method : str
        Name of the matcher; see ``MATCHERS``.
    slam : bool
        Whether to compile those of SLAM and localization too.
    cache : str, path or None
        Folder for code that travels: another process compiles it, and whoever finds the folder in NUMBA_CACHE_DIR, or
        as `_kernels` in the installed package, loads it wherever that is. Code of another version of curvescan, Numba
        or Python, or of another kind of processor, is passed over in silence. None: the cache of this machine.
    processor : str
        For which processor that folder is: "generic" for any of the kind of this one, "native" for this one alone.

    Returns
    -------
    float
        Seconds that it took.

    Raises
    ------
    InvalidArgumentError
        When the method or the processor is unknown.
    OutputError
        When the folder cannot be written, or the other process fails.
    """
    started = time.perf_counter()
    find_matcher(method, None)
    if processor not in get_args(Processor):
        raise InvalidArgumentError(f"processor must be one of {', '.join(get_args(Processor))}, got {processor!r}")
    if cache is not None:
        _compile_into(Path(cache).absolute(), f"compile_all({method!r}, {slam})", processor)
        return time.perf_counter() - started
    with watch.held():
        angle = 2.0 * np.pi * np.arange(2 * _N_LAP) / _N_LAP  # two laps on a circle
        laps = np.column_stack((_RADIUS_M * np.cos(angle), _RADIUS_M * np.sin(angle), angle + 0.5 * np.pi))
        _drive(method, laps)
        if slam:
            _map_and_localize(method, laps)
    # the compiler leaves a million objects: to look through them takes the collector a tenth of a second, in the middle
    # of a drive
    gc.collect()
    gc.freeze()
    return time.perf_counter() - started


def compile_all(method: str, slam: bool) -> None:
    """Compile what a run needs, and the few kernels of the simulator that `curvescan demo` needs besides."""
    from curvescan.simulation import simulate

    with watch.held():
        list(simulate("office", n_scans=2, n_people=1))
        warm_up(method, slam=slam)


def _compile_into(folder: Path, call: str, processor: str) -> None:
    """Have another process keep its machine code in a folder: where it goes is settled when kernels are imported."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror}; give a folder that can") from error
    ours = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")}
    named = {"NUMBA_CPU_NAME": processor} if processor == "generic" else {}
    env = ours | named | {"NUMBA_CACHE_DIR": str(folder)}
    status = subprocess.run(python_command(__name__, call), env=env, check=False).returncode
    if status:
        raise OutputError(f"{folder}: the process that compiles ended with status {status}, for the reason above")


def _drive(method: str, laps: Pose) -> None:
    """Match, with a guess and without, and follow the sensor there and back with a scan of the hall on the way."""
    room, hall = _scan(laps[0], _ROOM), _scan(laps[0], _HALL, person=9)
    ahead = laps[0] + (0.05, 0.0, 0.0)  # and the person in the hall keeps pace
    pairs = (room, room), (room, _scan(laps[1], _ROOM, person=40)), (room, hall), (hall, _scan(ahead, _HALL, person=9))
    for reference, current in pairs:
        match(reference, current, method=method)
        match(reference, current, method=method, guess=(0.1, 0.0, 0.0))
    there_and_back = laps[[0, 0, *range(8), *range(6, -1, -1)]]
    scans = [
        _scan(pose, _HALL if k in (5, 6) else _ROOM, k, person=10 * k, is_swept=True)
        for k, pose in enumerate(there_and_back)
    ]
    eigen3(np.eye(3))  # of what is known in corridors, and since a keyframe
    for config in (None, OdometryConfig.scan_to_scan()):
        run = run_engine(scans, Odometry(method, config=config), odometry_poses=there_and_back)
    build_maps(scans, run.trajectory.poses, run.is_joined, occupancy=OccupancyConfig())


def _map_and_localize(method: str, laps: Pose) -> None:
    """Map the room, close its loop, and find the sensor in the map."""
    # SciPy's sparse matrices take their time to load
    from curvescan.slam import Localizer, Slam
    from curvescan.slam.open_direction import n_through

    # keyframes that stand near, go soon, and close loops only where several agree
    often = {"keyframes": {"distance": 0.1}, "places": {"n_keyframes": 1}, "closures": {"log_odds": 20.0}}
    slam = Slam(method, config=often)
    scans = [_scan(pose, _ROOM, k) for k, pose in enumerate(laps)]
    for scan in scans:
        slam.add(scan)
    slam.finish()
    n_through(scans[0], scans[1], laps[:1])  # of corridors
    localizer = Localizer(slam.map)
    for scan in scans[:4]:
        localizer.add(scan)


def _scan(
    pose: Pose,
    rectangles: tuple[tuple[float, ...], ...],
    k: int = 0,
    *,
    person: int | None = None,
    is_swept: bool = False,
) -> LaserScan:
    """Return scan k, taken at a (3,) pose in a room, with a person before some of the beams."""
    angle = np.arange(_N_BEAMS) * (2.0 * np.pi / _N_BEAMS)
    c, s = np.cos(angle + pose[2]), np.sin(angle + pose[2])
    with np.errstate(divide="ignore"):
        walls = [
            np.minimum(
                np.where(c > 0.0, x_max - pose[0], x_min - pose[0]) / c,
                np.where(s > 0.0, y_max - pose[1], y_min - pose[1]) / s,
            )
            for x_min, x_max, y_min, y_max in rectangles
        ]
    ranges = np.maximum(*walls)
    if person is not None:
        ranges[person % _N_BEAMS : person % _N_BEAMS + 8] = 0.6
    return LaserScan(
        ranges,
        angle_min=0.0,
        angle_increment=float(angle[1]),
        range_max=_RANGE_MAX_M,
        stamp=k * _PERIOD_S,
        time_increment=_PERIOD_S / _N_BEAMS if is_swept else 0.0,
    )
