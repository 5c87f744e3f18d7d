"""The Cramér-Rao bound of a pair of scans: no unbiased matcher can do better on them.

A. Censi, "On achievable accuracy for range-finder localization", ICRA 2007: the information that a beam holds on the
pose is the square of how its range changes with the pose, over the noise. There the map is known; here it is the
other scan, as noisy as the first, so that each beam that both scans can compare carries the noise twice.
"""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.simulation import ScanPair, Sensor, World
from curvescan.simulation.sensing.sensors import cast_beams
from curvescan.types import Bools, Cov, Floats, Ints, Points, Pose

_SAME_SURFACE = 0.05  # two readings this near to one another, metres, are of one surface


def range_gradient(world: World, pose: Pose, sensor: Sensor) -> tuple[Floats, Floats]:
    """Return the exact ranges of a sweep and how they change with the sensor's pose.

    pose (3,); ranges (n,): Metres; inf where nothing is met; gradient (n, 3).
    """
    ranges, hit_idx = cast_beams(world, pose, sensor)
    angles = sensor.angle_min + sensor.angle_increment * np.arange(sensor.n_beams)
    beams = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = _normals(world, pose, ranges[:, np.newaxis] * beams, hit_idx)
        along = np.sum(normals * beams, axis=1)
        across = normals[:, 1] * beams[:, 0] - normals[:, 0] * beams[:, 1]
        gradient = -np.column_stack([normals, ranges * across]) / along[:, np.newaxis]
    gradient[hit_idx < 0] = np.nan
    return ranges, gradient


def pair_bound(pair: ScanPair, sensor: Sensor) -> Cov:
    """Return the least covariance that an unbiased estimate of a pair's pose can have.

    Only beams count that both scans can compare: not on people, and on a surface that the other scan has a reading
    of.

    result (3, 3).
    """
    poses = (pair.reference_pose, se2.compose(pair.reference_pose, pair.pose))
    usable = (pair.reference.valid & ~pair.is_person_ref, pair.current.valid & ~pair.is_person_cur)
    swept = [range_gradient(pair.world, pose, sensor) for pose in poses]
    information = np.zeros((3, 3))
    for own, other in ((0, 1), (1, 0)):
        ranges, gradient = swept[own]
        counts = usable[own] & ~np.isnan(gradient).any(axis=1)
        counts &= _is_seen(ranges, se2.between(poses[other], poses[own]), swept[other][0], usable[other], sensor)
        seen = gradient[counts]
        half = 0.5 * seen.T @ seen / (2.0 * sensor.sigma_range**2)
        if own == 0:
            # moving the reference by d moves the current scan, seen from it, by -d brought into its frame
            change = _adjoint(se2.inverse(pair.pose))
            back = np.linalg.inv(change)
            half = back.T @ half @ back
        information += half
    if np.linalg.eigvalsh(information)[0] <= 1e-6 * np.trace(information):
        return np.full((3, 3), np.nan)
    turn = np.eye(3)
    turn[:2, :2] = se2.rotation(pair.pose[2])
    bound: Cov = turn @ np.linalg.inv(information) @ turn.T
    return bound


def median_error(bounds: list[Cov], *, seed: int = 0) -> float:
    """Return the median translation error, metres, that matches at their bounds would have.

    bounds: One a pair; NaN ones are left out.
    """
    rng = np.random.default_rng(seed)
    errors = [
        np.hypot(*rng.multivariate_normal(np.zeros(2), bound[:2, :2], 200, method="cholesky").T)
        for bound in bounds
        if np.isfinite(bound).all()
    ]
    return float(np.median(errors)) if errors else float("nan")


def _normals(world: World, pose: Pose, points: Points, hit_idx: Ints) -> Points:
    """Return the unit normal, in the sensor frame, of the surface at each point that is hit."""
    segments, curves = world.segments, world.curves
    centres = np.zeros_like(points)
    straight = np.stack([segments[:, 1] - segments[:, 3], segments[:, 2] - segments[:, 0]], axis=1)
    is_straight = (hit_idx >= 0) & (hit_idx < len(segments))
    is_curved = hit_idx >= len(segments)
    normals = np.full_like(points, np.nan)
    turn_back = se2.rotation(-pose[2])
    normals[is_straight] = straight[hit_idx[is_straight]] @ turn_back.T
    inverse = se2.inverse(pose)
    centres[is_curved] = se2.transform(inverse, curves[hit_idx[is_curved] - len(segments), :2])
    normals[is_curved] = points[is_curved] - centres[is_curved]
    unit: Points = normals / np.hypot(normals[:, 0], normals[:, 1])[:, np.newaxis]
    return unit


def _is_seen(ranges: Floats, pose: Pose, other_ranges: Floats, other_usable: Bools, sensor: Sensor) -> Bools:
    """Return (n,) whether the other scan has a usable reading next to each exact reading of this one."""
    angles = sensor.angle_min + sensor.angle_increment * np.arange(sensor.n_beams)
    is_hit = np.isfinite(ranges)
    reach = np.where(is_hit, ranges, 0.0)
    own = np.stack([reach * np.cos(angles), reach * np.sin(angles)], axis=1)
    x, y = se2.transform(pose, own).T
    distance = np.hypot(x, y)
    turn = np.sign(sensor.angle_increment) * (np.arctan2(y, x) - sensor.angle_min)
    beam = np.round(np.remainder(turn, 2.0 * np.pi) / abs(sensor.angle_increment)).astype(np.int64)
    n = sensor.n_beams
    is_closed = n * abs(sensor.angle_increment) > 2.0 * np.pi - 1.5 * abs(sensor.angle_increment)
    beam = beam % n if is_closed else beam
    seen = np.zeros(n, dtype=np.bool_)
    for step in (-1, 0, 1):
        near = (beam + step) % n if is_closed else np.clip(beam + step, 0, n - 1)
        near = np.minimum(near, n - 1)
        with np.errstate(invalid="ignore"):
            same = np.abs(other_ranges[near] - distance) < _SAME_SURFACE
        seen |= same & other_usable[near]
    is_comparable: Bools = seen & is_hit & (beam < n)
    return is_comparable


def _adjoint(pose: Pose) -> Floats:
    """Return (3, 3) how a small motion in frame b reads in frame a, for the pose of b in a."""
    matrix = np.eye(3)
    matrix[:2, :2] = se2.rotation(pose[2])
    matrix[:2, 2] = pose[1], -pose[0]
    return matrix
