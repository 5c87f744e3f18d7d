"""Exact ray casting: what a fan of beams meets first in a world.

Each primitive is tested only against the beams that point at it: its bearing interval, one beam wider than needed, is
turned into beam indices once a scan. A beam within 1 nm of the end of a wall hits it; one exactly along a wall does
not see it; a sensor inside a circle sees it from within.
"""

import numpy as np
from numpy.typing import ArrayLike

from curvescan._jit import kernel
from curvescan.errors import InvalidArgumentError
from curvescan.simulation.buildings.world import World, full_circles
from curvescan.types import Floats, Ints, Points, Pose

_SLIT = 1e-9


def cast_rays(
    world: World,
    pose: ArrayLike,
    *,
    angle_min: float,
    angle_increment: float,
    n_beams: int,
    range_max: float = np.inf,
    people: ArrayLike | None = None,
) -> tuple[Floats, Ints]:
    """Return the exact range of each beam of a fan, inf where nothing is within range_max, and what it hits."""
    x, y, theta = np.asarray(pose, dtype=np.float64)
    if angle_increment == 0.0:
        raise InvalidArgumentError("angle_increment must not be 0")
    segments, curves = _primitives(world, people)
    heading = theta + angle_min
    start, span = _bearings(segments, curves, x, y, range_max)
    primitive_idx, first, last = _beam_intervals(start - heading, span, angle_increment, n_beams)
    angles = heading + angle_increment * np.arange(n_beams)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    origins = np.tile([[x, y]], (n_beams, 1))
    return _cast(segments, curves, origins, directions, primitive_idx, first, last, range_max)


def cast_sweep(
    world: World, poses: Pose, angles: Floats, *, range_max: float = np.inf, people: ArrayLike | None = None
) -> tuple[Floats, Ints]:
    """Return the exact ranges, and hits, of a sweep on the move, (n, 3) poses: each beam is tested with everything."""
    segments, curves = _primitives(world, people)
    x, y = (float(value) for value in poses[len(poses) // 2, :2])
    reach = range_max + float(np.max(np.hypot(poses[:, 0] - x, poses[:, 1] - y)))
    _, span = _bearings(segments, curves, x, y, reach)
    near = np.flatnonzero(span >= 0.0)
    bearings = poses[:, 2] + angles
    directions = np.column_stack([np.cos(bearings), np.sin(bearings)])
    first, last = np.zeros(near.size, dtype=np.int64), np.full(near.size, len(poses) - 1)
    origins = np.ascontiguousarray(poses[:, :2])
    return _cast(segments, curves, origins, directions, near, first, last, range_max)


def _primitives(world: World, people: ArrayLike | None) -> tuple[Floats, Floats]:
    """Return the segments and curves of a world, people among the curves."""
    if people is None or not np.size(people):
        return world.segments, world.curves
    return world.segments, np.vstack([world.curves, full_circles(np.asarray(people, dtype=np.float64))])


def _bearings(segments: Floats, curves: Floats, x: float, y: float, range_max: float) -> Floats:
    """Return (2, n) clockwise end and angle of each segment, then of each whole circle, as seen from a place, radians.

    The angle is negative where it is out of range, and 2 pi where the place lies on a segment or in a circle.
    """
    x0, y0, x1, y1 = (segments - np.array([x, y, x, y])).T
    start = np.arctan2(y0, x0)
    turn = np.arctan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
    span = np.abs(turn)
    span[span > np.pi - 1e-6] = 2.0 * np.pi
    span[np.hypot(x0 + x1, y0 + y1) - np.hypot(x1 - x0, y1 - y0) > 2.0 * range_max + 1e-6] = -1.0
    start = np.where(turn < 0.0, start + turn, start)

    dx, dy, radius = curves[:, 0] - x, curves[:, 1] - y, curves[:, 2]
    distance = np.hypot(dx, dy)
    is_inside = distance <= radius * (1.0 + 1e-9)
    half = np.arcsin(radius / np.where(is_inside, radius, distance))
    span_curves = np.where(is_inside, 2.0 * np.pi, 2.0 * half)
    span_curves[distance - radius > range_max + 1e-6] = -1.0
    return np.array([np.append(start, np.arctan2(dy, dx) - half), np.append(span, span_curves)])


def _beam_intervals(start: Floats, span: Floats, step: float, n_beams: int) -> tuple[Ints, Ints, Ints]:
    """Return primitive, first and last beam of every interval to test, counted from beam 0; one may have several."""
    if step < 0.0:
        start = -(start + span)
        step = -step
    turn = 2.0 * np.pi / step
    seen = np.flatnonzero((span >= 0.0) & np.isfinite(start))
    low = np.remainder(start[seen] / step, turn)
    high = low + span[seen] / step
    shifts = turn * np.arange(-1, int(np.ceil(n_beams / turn)) + 1)[:, np.newaxis]
    first = np.maximum(np.floor(low + shifts).astype(np.int64) - 1, 0).ravel()
    last = np.minimum(np.ceil(high + shifts).astype(np.int64) + 1, n_beams - 1).ravel()
    kept = np.flatnonzero(first <= last)
    return np.tile(seen, len(shifts))[kept], first[kept], last[kept]


@kernel
def _cast(
    segments: Floats,
    curves: Floats,
    origins: Points,
    directions: Floats,
    primitive_idx: Ints,
    first: Ints,
    last: Ints,
    range_max: float,
) -> tuple[Floats, Ints]:
    ranges = np.full(directions.shape[0], np.inf)
    hit_idx = np.full(directions.shape[0], -1)
    n_segments = segments.shape[0]
    for k in range(primitive_idx.size):
        i = primitive_idx[k]
        is_segment = i < n_segments
        row = segments[i] if is_segment else curves[i - n_segments]
        if is_segment:
            ex = row[2] - row[0]
            ey = row[3] - row[1]
            slit = _SLIT / max(np.hypot(ex, ey), _SLIT)
        for j in range(first[k], last[k] + 1):
            ax = row[0] - origins[j, 0]
            ay = row[1] - origins[j, 1]
            dx = directions[j, 0]
            dy = directions[j, 1]
            offset = ax * dy - ay * dx  # of the primitive's anchor from the beam, to its right
            distance = np.inf
            if is_segment:
                facing = dx * ey - dy * ex
                if facing != 0.0 and -slit <= offset / facing <= 1.0 + slit:
                    distance = (ax * ey - ay * ex) / facing
            elif abs(offset) <= row[2]:
                half_chord = np.sqrt((row[2] - offset) * (row[2] + offset))
                for side in (1.0, -1.0):  # the far crossing, then the near one
                    t = ax * dx + ay * dy + side * half_chord
                    from_middle = (t * dx - ax) * row[3] + (t * dy - ay) * row[4]
                    if t >= 0.0 and from_middle >= row[2] * row[5] - _SLIT:
                        distance = t
            if 0.0 <= distance <= range_max and distance < ranges[j]:
                ranges[j] = distance
                hit_idx[j] = i
    return ranges, hit_idx
