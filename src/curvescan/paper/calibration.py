"""The paper's way of finding its parameters, from scans of plane surfaces and of corners (the paper's section 3.1).

sigma_rho: the least margin at which a wall that is seen at a grazing angle stays one segment. U_k: the least tolerance
at which no false peak shows on a plane. U_c: just above what the functions of planes, which are noise, correlate. U_p:
the least at which planes show none, as it finds most corners. n and S_min: see
:mod:`curvescan.paper.calibration_pairs`.
"""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from curvescan.configs import as_config
from curvescan.errors import InvalidArgumentError
from curvescan.io.log import Log
from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.matchers.cfsma.curvature import curvature_functions
from curvescan.matchers.cfsma.functions import correlations, spectra
from curvescan.matchers.cfsma.landmarks import characteristic_points
from curvescan.matchers.cfsma.segmentation import segment
from curvescan.paper.calibration_pairs import PairCalibration, calibrate_on_pairs
from curvescan.scan import LaserScan, valid_readings
from curvescan.simulation import Sensor
from curvescan.types import Bools, Floats, Ints, Points


def wall_scans(
    sensor: Sensor, distance: float, *, sigma: float, n_scans: int, seed: int, angle: float = 0.0
) -> list[LaserScan]:
    """Return scans of a plane ahead, or of a corner in it, with Gaussian range noise."""
    beams = sensor.angle_min + sensor.angle_increment * np.arange(sensor.n_beams)
    # each half is a line through (distance, 0) that leans by `angle` away from the sensor
    with np.errstate(divide="ignore"):
        exact = distance * np.cos(angle) / np.cos(np.abs(beams) + angle)
    exact = np.where((np.abs(beams) + angle < np.pi / 2) & (exact > 0.0), exact, np.inf)
    rng = np.random.default_rng(seed)
    return [
        LaserScan(
            exact + sigma * rng.standard_normal(beams.size),
            angle_min=sensor.angle_min,
            angle_increment=sensor.angle_increment,
            range_min=sensor.range_min,
            range_max=sensor.range_max,
        )
        for _ in range(n_scans)
    ]


TOLERANCES: Floats = np.array([5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 120, 150, 200]) / 1000
"""U_k tried, metres."""

SIGMAS: Floats = np.array([5, 10, 20, 30, 50, 80, 120, 200]) / 1000  # sigma_rho tried, metres

WALL, REACH = 0.9, 8.0
"""A wall this far beside the sensor, as of a corridor 1.8 m wide, shall stay whole out to this range, metres."""

_WHOLE = 0.9  # share of the scans in which such a wall shall be whole
CURVATURES: Floats = np.arange(0.05, 1.01, 0.05)  # U_p tried, radians
CORNER_ANGLES: Floats = np.radians([30, 45, 60, 75, 90])  # angles by which the corners turn, radians
_FREE = 0.1  # mean number of peaks a plane may show where none is said to show
_QUIET = 0.01  # share of the planes that may show a peak at the chosen U_p: the least such U_p finds most corners
_LEAST_PLANE = 20  # readings that a surface must have to be judged a plane
_MOST_PLANES = 400  # planes taken from a log, in its order

_NEAR_CORNER = 3
"""Readings by which a peak may lie farther from its corner than eq. 3 puts it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlaneGroup:
    """Planes that belong together: at one distance, or of one log."""

    name: str  # "2 m", say
    planes: tuple[Points, ...]  # readings of each plane in sweep order, metres, sensor frame


@dataclass(frozen=True, eq=False, kw_only=True)
class Calibration:
    """What was measured, and the parameters that follow."""

    config: CfSmaConfig  # the parameters found; the others keep their defaults
    noise: float  # range noise that the planes show, metres
    whole: Floats  # share of the scans in which a wall beside the sensor is one segment, for each sigma_rho
    pairs: PairCalibration  # how n and S_min were found
    groups: tuple[PlaneGroup, ...]  # the planes
    false_peaks: Floats  # mean number of characteristic points a plane shows, for each group and U_k
    is_free: Bools  # (g,): whether some U_k leaves a group without peaks; the others were left out of the choice
    residual_correlations: Floats  # (k,): correlations of pairs of plane functions at the chosen U_k, sorted
    # share of corners found, and of planes that show a peak, for each U_p
    detection: Floats
    false_alarms: Floats


def simulated_planes(
    sensor: Sensor, distances: Iterable[float], *, n_scans: int = 40, seed: int = 0
) -> tuple[PlaneGroup, ...]:
    """Return planes ahead of a simulated sensor, a group a distance (metres)."""
    groups = []
    for k, distance in enumerate(distances):
        scans = wall_scans(sensor, distance, sigma=sensor.sigma_range, n_scans=n_scans, seed=seed + k)
        planes = tuple(scan.points[scan.valid] for scan in scans)
        if len(planes[0]) < _LEAST_PLANE:
            raise InvalidArgumentError(
                f"a plane {distance} m away gives {sensor.name} only {len(planes[0])} readings, "
                f"{_LEAST_PLANE} are needed: choose smaller distances"
            )
        groups.append(PlaneGroup(name=f"{distance:g} m", planes=planes))
    return tuple(groups)


def planes_of_log(scans: Iterable[LaserScan], name: str) -> tuple[PlaneGroup, ...]:
    """Return the plane surfaces of a log as one group: segments that a straight line explains."""
    planes: list[Points] = []
    config = replace(CfSmaConfig().segmentation, range_sigma=0.01)
    for scan in scans:
        readings = valid_readings(scan)
        segments = segment(readings, config)
        for start, stop in zip(segments.starts, segments.stops, strict=True):
            points = readings.points[segments.order[start:stop]]
            if len(points) >= _LEAST_PLANE and _is_plane(points):
                planes.append(points)
        if len(planes) >= _MOST_PLANES:
            break
    if not planes:
        raise InvalidArgumentError(
            f"{name} shows no plane of {_LEAST_PLANE} readings: record the sensor in front of a bare wall"
        )
    return (PlaneGroup(name=name, planes=tuple(planes)),)


def sensor_of_log(log: Log) -> Sensor:
    """Return a simulated sensor with the beams and limits of a log's first scan, without noise."""
    scan = next(iter(log))
    return Sensor(
        name=log.name,
        n_beams=len(scan),
        angle_min=scan.angle_min,
        angle_increment=scan.mean_increment,  # a simulated sensor has even beams
        range_min=scan.range_min,
        range_max=scan.range_max,
        sigma_range=0.0,
        dropout=0.0,
        period=1.0,
    )


def calibrate(groups: tuple[PlaneGroup, ...], sensor: Sensor, *, n_scans: int = 40, seed: int = 0) -> Calibration:
    """Return the six parameters that planes, corners and pairs of scans decide; lambda is the paper's."""
    sigma = float(np.median([_sigma(plane) for group in groups for plane in group.planes]))
    base = CfSmaConfig()
    noisy = replace(sensor, sigma_range=sigma)
    whole = np.array([_share_whole(noisy, base, s, n_scans, seed) for s in SIGMAS])
    # a wall that no margin keeps whole lies beyond what the sensor can see: the widest margin is taken
    sigma_rho = float(SIGMAS[np.argmax(whole >= _WHOLE)] if (whole >= _WHOLE).any() else SIGMAS[-1])
    base = as_config({"segmentation": {"range_sigma": sigma_rho}}, base)

    by_u_k = [as_config({"curvature": {"arc_tolerance": u_k}}, base) for u_k in TOLERANCES]
    false_peaks = np.array([[np.mean([_n_peaks(p, one) for p in g.planes]) for one in by_u_k] for g in groups])
    is_free: Bools = np.any(false_peaks <= _FREE, axis=1)
    if not is_free.any():
        raise InvalidArgumentError(
            f"no U_k up to {TOLERANCES[-1]:g} m leaves any of the planes without a false peak: "
            "their noise is larger than the distance of neighbouring readings, choose planes farther away"
        )
    enough = (false_peaks[is_free] <= _FREE).all(axis=0)
    # beyond the first tolerance that serves, all should; a lone later peak does not matter
    config = by_u_k[np.argmax(enough)]

    residual = _residual_correlations(groups, config)
    u_c = float(np.ceil(20.0 * np.percentile(residual, 95.0)) / 20.0) if residual.size else 0.4
    config = as_config({"functions": {"min_correlation": min(u_c, 0.95)}}, config)

    free_planes = [p for g, free in zip(groups, is_free, strict=True) if free for p in g.planes]
    corners = _corners(sensor, sigma, n_scans, seed)
    by_u_p = [as_config({"landmarks": {"min_curvature": round(u_p, 3)}}, config) for u_p in (*CURVATURES, 1.0)]
    detection = np.array([_found(corners, one) for one in by_u_p[:-1]])
    false_alarms = np.array([np.mean([_n_peaks(p, one) > 0 for p in free_planes]) for one in by_u_p[:-1]])
    is_quiet = false_alarms <= _QUIET
    config = by_u_p[np.argmax(is_quiet) if is_quiet.any() else -1]
    pairs = calibrate_on_pairs(config, noisy, n_pairs=5 * n_scans, seed=seed + 2000)
    landmarks = {"n_neighbours": pairs.n_neighbours, "min_similarity": pairs.min_similarity}
    return Calibration(
        config=as_config({"landmarks": landmarks}, config),
        noise=sigma,
        whole=whole,
        pairs=pairs,
        groups=groups,
        false_peaks=false_peaks,
        is_free=is_free,
        residual_correlations=residual,
        detection=detection,
        false_alarms=false_alarms,
    )


def _share_whole(sensor: Sensor, config: CfSmaConfig, range_sigma: float, n_scans: int, seed: int) -> float:
    """Return the share of scans in which a wall WALL beside the sensor is one segment out to REACH."""
    segmentation = replace(config.segmentation, range_sigma=range_sigma)
    limit = np.arcsin(WALL / max(min(sensor.range_max, REACH), 2.0 * WALL))
    bearings = sensor.angle_min + sensor.angle_increment * np.arange(sensor.n_beams)
    # the wall runs along x: a beam's bearing is its angle of incidence
    incidence = np.sort(bearings[(bearings > limit) & (bearings < np.pi / 2)])
    exact = WALL / np.sin(incidence)
    rng = np.random.default_rng(seed)
    n_whole = 0
    for _ in range(n_scans):
        scan = LaserScan(
            exact + sensor.sigma_range * rng.standard_normal(exact.size),
            angle_min=float(incidence[0]),
            angle_increment=abs(sensor.angle_increment),
        )
        segments = segment(valid_readings(scan), segmentation)
        n_whole += int(len(segments) == 1 and segments.stops[0] - segments.starts[0] == exact.size)
    return n_whole / n_scans


def _functions(plane: Points, config: CfSmaConfig) -> tuple[Floats, tuple[Ints, Ints]]:
    whole = (np.array([0]), np.array([len(plane)]))
    return curvature_functions(plane, *whole, config.curvature)[0], whole


def _peaks(surface: Points, config: CfSmaConfig) -> Ints:
    """Return the readings of a surface that are characteristic points."""
    eta, whole = _functions(surface, config)
    return characteristic_points(eta, *whole, config.landmarks).extents[:, 0]


def _n_peaks(surface: Points, config: CfSmaConfig) -> int:
    return _peaks(surface, config).size


def _residual_correlations(groups: tuple[PlaneGroup, ...], config: CfSmaConfig) -> Floats:
    length = config.functions.length
    found = [np.empty(0)]
    for group in groups:
        functions = (_functions(plane, config) for plane in group.planes)
        rows = [spectra(eta, *whole, length) for eta, whole in functions if eta.any()][:100]
        if len(rows) > 1:
            upsilon = correlations(np.concatenate(rows), np.concatenate(rows), length)
            found.append(upsilon[np.triu_indices(len(rows), k=1)])
    return np.sort(np.concatenate(found))


class _Corner(NamedTuple):
    points: Points
    at: Points  # (2,) where it is
    turn: float  # radians


def _corners(sensor: Sensor, sigma: float, n_scans: int, seed: int) -> list[_Corner]:
    """Return corners of all angles, 2 to 4 m away."""
    return [
        _Corner(scan.points[scan.valid], np.array([distance, 0.0]), float(turn))
        for k, (distance, turn) in enumerate(itertools.product((2, 3, 4), CORNER_ANGLES))
        for scan in wall_scans(sensor, distance, sigma=sigma, n_scans=n_scans, seed=seed + 1000 + k, angle=turn / 2.0)
    ]


def _found(corners: list[_Corner], config: CfSmaConfig) -> float:
    """Return the share of corners that show a peak where eq. 3 puts it: U_k / (1 - cos(turn)) before the corner.

    Two sides of length a and b waste a + b - c of their arc on the chord c, so that the walk goes round the corner
    early.
    """
    n_found = 0
    for points, at, turn in corners:
        peaks = _peaks(points, config)
        step = np.median(np.hypot(*np.diff(points, axis=0).T))
        reach = config.curvature.arc_tolerance / (1.0 - np.cos(turn)) + _NEAR_CORNER * step
        n_found += bool((np.hypot(*(points[peaks] - at).T) <= reach).any())
    return n_found / len(corners)


def _line(points: Points) -> tuple[Points, float]:
    """Return the unit normal and the distance from the origin of the line nearest to the points."""
    centre = points.mean(axis=0)
    normal = np.linalg.svd(points - centre, full_matrices=False)[2][1]
    return normal, float(normal @ centre)


def _is_plane(points: Points) -> bool:
    """Return whether a line explains the points, and what it leaves is noise and not a bend."""
    normal, offset = _line(points)
    residual = points @ normal - offset
    is_thin = residual.std() < 0.03 and np.ptp(points, axis=0).max() > 0.5
    thirds = [part.mean() for part in np.array_split(residual, 3)]
    return bool(is_thin and np.ptp(thirds) < residual.std())


def _sigma(points: Points) -> float:
    """Return the range noise that readings of a plane show, metres: robust, along the beams."""
    normal, offset = _line(points)
    ranges = np.hypot(points[:, 0], points[:, 1])
    incidence = np.abs(points @ normal) / ranges
    steep = incidence > 0.5  # grazing beams say little of the range
    if np.count_nonzero(steep) < 5:
        steep = np.ones(len(points), dtype=np.bool_)
    residual = (points @ normal - offset)[steep] / incidence[steep]
    return float(1.4826 * np.median(np.abs(residual - np.median(residual))))
