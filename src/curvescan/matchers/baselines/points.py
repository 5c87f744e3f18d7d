"""What the iterated methods know of one scan: readings, surfaces, normals; and IDC's filters (Lu and Milios 1997)."""

import math
from dataclasses import dataclass, replace

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.matchers.cfsma.config import SegmentationConfig
from curvescan.matchers.cfsma.segmentation import segment
from curvescan.scan import LaserScan, Readings, valid_readings
from curvescan.se2.uncertain import wrap_angle
from curvescan.types import Bools, Floats, Ints, Points, Pose

HIDDEN_MARGIN = 0.1  # how far behind another surface a reading must lie to be hidden by it, metres


def median_filter(readings: Readings, n_readings: int) -> Readings:
    """Return readings whose ranges are the medians of their neighbours: single stray readings are gone."""
    if n_readings == 1 or len(readings) < n_readings:
        return readings
    half = n_readings // 2
    padded = np.pad(readings.ranges, half, mode="wrap" if readings.is_closed else "edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, n_readings)
    ranges = np.ascontiguousarray(np.sort(windows, axis=1)[:, half])
    return replace(readings, ranges=ranges, points=readings.points * (ranges / readings.ranges)[:, np.newaxis])


@kernel
def is_visible(points: Points, is_joined: Bools, angle_step: float) -> Bools:
    """Return which readings a viewer at the origin sees: from the front, nothing before them (projection filter).

    All stretches that face the origin are drawn into a ring of least ranges, then each reading is looked up.
    """
    n = points.shape[0]
    n_bins = math.ceil(2.0 * math.pi / max(angle_step, 1e-3))
    width = 2.0 * math.pi / n_bins
    nearest = np.full(n_bins, np.inf)
    bearings, ranges = np.empty(n), np.empty(n)
    for i in range(n):
        bearings[i] = math.atan2(points[i, 1], points[i, 0])
        ranges[i] = math.hypot(points[i, 0], points[i, 1])
    turns_back: Floats = np.zeros(n)  # how many of a reading's stretches are seen from behind
    for i in range(n):
        if not is_joined[i]:
            continue
        following = i + 1 if i + 1 < n else 0
        turn = wrap_angle(bearings[following] - bearings[i])
        if turn < 0.0:
            turns_back[i] += 1
            turns_back[following] += 1
            continue
        first = math.floor((bearings[i] + math.pi) / width)
        for k in range(int(turn / width) + 1):
            share = min(k * width / turn, 1.0) if turn > 0.0 else 0.0
            reach = ranges[i] + share * (ranges[following] - ranges[i])
            at = int(first + k) % n_bins
            nearest[at] = min(nearest[at], reach)
    visible = np.ones(n, dtype=np.bool_)
    for i in range(n):
        at = math.floor((bearings[i] + math.pi) / width) % n_bins
        visible[i] = turns_back[i] < 2 and ranges[i] <= nearest[at] + HIDDEN_MARGIN
    return visible


_SURFACES = SegmentationConfig(range_sigma=0.01, min_readings=3)
ARM = 0.15
"""Half length of the stretch of surface a tangent is fitted to, metres: 10 mm of noise then turn it by
2 to 3 degrees at any range, as the readings on the stretch are many where they are near."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ScanPoints(Readings):
    """The valid readings of a scan, counter-clockwise, with the surfaces they lie on."""

    # (m,): whether the surface goes on from a reading to the next (from the last to the first on a full circle)
    is_joined: Bools
    # (m, 2): unit vector along the surface, counter-clockwise as the sensor sees it; NaN on isolated readings
    tangents: Points
    # (s,): surface k holds the readings order[starts[k]:stops[k]]
    starts: Ints
    stops: Ints
    order: Ints  # (m,): readings surface by surface, so that no surface is cut by the seam of a full circle

    @property
    def normals(self) -> Points:
        """(m, 2) tangents turned left by a quarter; NaN on isolated readings."""
        return np.stack([-self.tangents[:, 1], self.tangents[:, 0]], axis=1)


def sweep_of(scan: LaserScan, median_readings: int = 1) -> ScanPoints:
    """Return the valid readings of a scan, median-filtered, with their tangents and surfaces.

    Surfaces end as Borges and Aldon's breakpoint detector (2004) ends them.
    """
    readings = median_filter(valid_readings(scan), median_readings)
    segments = segment(readings, _SURFACES)
    is_joined = np.zeros(len(readings), dtype=np.bool_)
    tangents = np.full((len(readings), 2), np.nan)
    in_order = readings.points[segments.order]
    tangents[segments.order] = _tangents(in_order, segments.starts, segments.stops, ARM)
    for start, stop in zip(segments.starts, segments.stops, strict=True):
        is_joined[segments.order[start : stop - 1]] = True
    return ScanPoints(**vars(readings), **vars(segments), is_joined=is_joined, tangents=tangents)


def hidden_readings(reference: ScanPoints, current: ScanPoints, guess: Pose) -> tuple[Bools, Bools]:
    """Return which readings of cur, and of ref, the other viewpoint cannot see if the guess is right.

    Lu and Milios do it once, before the first step. At every step it would trust poses that are still wrong.
    """
    cur_in_ref = se2.transform(guess, current.points)
    ref_in_cur = se2.transform(se2.inverse(guess), reference.points)
    return (
        ~is_visible(cur_in_ref, current.is_joined, reference.angle_step),
        ~is_visible(ref_in_cur, reference.is_joined, current.angle_step),
    )


@kernel
def _tangents(points: Points, starts: Ints, stops: Ints, arm: float) -> Points:
    """Return the direction of the total least squares line through each reading and its neighbours within `arm`."""
    tangents = np.full(points.shape, np.nan)
    for s in range(starts.size):
        for i in range(starts[s], stops[s]):
            first, last = i, i
            while first > starts[s] and (
                first == i
                or math.hypot(points[first - 1, 0] - points[i, 0], points[first - 1, 1] - points[i, 1]) <= arm
            ):
                first -= 1
            while last < stops[s] - 1 and (
                last == i or math.hypot(points[last + 1, 0] - points[i, 0], points[last + 1, 1] - points[i, 1]) <= arm
            ):
                last += 1
            _, _, tangents[i, 0], tangents[i, 1] = fit_line(points, first, last + 1)
    return tangents


@kernel
def fit_line(points: Points, start: int, stop: int) -> tuple[float, float, float, float]:
    """Return centre and direction of the total least squares line through readings, from the first to the last."""
    n = stop - start
    cx, cy = 0.0, 0.0
    for k in range(start, stop):
        cx += points[k, 0] / n
        cy += points[k, 1] / n
    xx, xy, yy = 0.0, 0.0, 0.0
    for k in range(start, stop):
        dx, dy = points[k, 0] - cx, points[k, 1] - cy
        xx += dx * dx
        xy += dx * dy
        yy += dy * dy
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    ux, uy = math.cos(angle), math.sin(angle)
    if ux * (points[stop - 1, 0] - points[start, 0]) + uy * (points[stop - 1, 1] - points[start, 1]) < 0.0:
        ux, uy = -ux, -uy
    return cx, cy, ux, uy
