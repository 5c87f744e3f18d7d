"""What IDC does to scans before it matches them: median filter and projection filter (Lu and Milios 1997)."""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.scan import Readings
from curvescan.se2.angles import wrap_angle
from curvescan.types import Bools, Floats, Points

HIDDEN_MARGIN = 0.1  # how far behind another surface a reading must lie to be hidden by it, metres


def median_filter(readings: Readings, n_readings: int) -> Readings:
    """Return readings whose ranges are the medians of their neighbours: single stray readings are gone."""
    if n_readings == 1 or len(readings) < n_readings:
        return readings
    half = n_readings // 2
    padded = np.pad(readings.ranges, half, mode="wrap" if readings.is_closed else "edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, n_readings)
    ranges = np.ascontiguousarray(np.sort(windows, axis=1)[:, half])
    return Readings(
        beam_idx=readings.beam_idx,
        ranges=ranges,
        angles=readings.angles,
        points=readings.points * (ranges / readings.ranges)[:, np.newaxis],
        angle_step=readings.angle_step,
        n_beams=readings.n_beams,
        is_closed=readings.is_closed,
    )


def is_visible(points: Points, is_joined: Bools, angle_step: float) -> Bools:
    """Return which readings can be seen from the origin of the frame they are given in (projection filter).

    A reading is hidden when the surface is seen from behind there, or when another surface stands before it.

    points (n, 2); is_joined (n,).
    """
    return _is_visible(points, is_joined, max(angle_step, 1e-3), HIDDEN_MARGIN)


@kernel
def _is_visible(points: Points, is_joined: Bools, angle_step: float, margin: float) -> Bools:
    """Draw all stretches that face the origin into a ring of least ranges, then look each reading up."""
    n = points.shape[0]
    n_bins = math.ceil(2.0 * math.pi / angle_step)
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
        visible[i] = turns_back[i] < 2 and ranges[i] <= nearest[at] + margin
    return visible
