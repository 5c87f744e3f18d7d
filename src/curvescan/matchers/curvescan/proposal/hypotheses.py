"""Hypotheses: turns from the directions of surfaces, and for each the places at which walls and edges coincide.

The histogram of the directions of all surfaces turns with the sensor. What faces along an axis of the scene makes a
profile of lengths by place. Where those of two scans correlate is a candidate (Weiss and von Puttkamer 1995).
Departure: stretches of wall count by the root of their length, and edges stand in the profiles as well. Of a corridor
the jambs of doors are all that lies across.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.config import NEAR, SAME
from curvescan.matchers.curvescan.features.landmarks import FACING_X, FACING_Y, MARK_X, MARK_Y, Landmarks
from curvescan.matchers.curvescan.features.objects import STANDS_BEFORE
from curvescan.matchers.curvescan.features.range_image import RangeImage, reading_at
from curvescan.matchers.curvescan.features.surfels import RANGE
from curvescan.se2.uncertain import wrap_angle
from curvescan.types import Floats

_BIN = 2.0 * SAME  # metres
# Bins of a profile: what lies 25.6 m on is in the same ones. Of these as many shifts are tried, 6.4 m each way: farther
# off is no less likely than three standard deviations of the wide prior.
_N_BINS, _N_SHIFTS = 128, 64
_EDGE_LENGTH = NEAR  # metres of wall that an edge counts as
_N_PLACES = 12  # along each axis


@kernel
def rotation_hypotheses(histogram_ref: Floats, histogram_cur: Floats, n_rotations: int, around: Floats) -> Floats:
    """Return (k, 3) the pose `around`, and its place with the rotations at which the histograms correlate best."""
    n = histogram_ref.size
    likeness, twice = np.zeros(n), np.empty(2 * n)
    for k in range(n):
        twice[k] = twice[k + n] = histogram_ref[k]
    correlate(likeness, twice, histogram_cur, 0)
    shifts, _ = peaks_of(likeness, n_rotations)
    poses = np.empty((shifts.size + 1, 3))
    for k in range(poses.shape[0]):
        poses[k, 0], poses[k, 1] = around[0], around[1]
        poses[k, 2] = around[2] if k == 0 else wrap_angle(shifts[k - 1] * 2.0 * math.pi / n)
    return poses


@kernel
def correlate(likeness: Floats, twice: Floats, other: Floats, first: int) -> None:
    """Add to (k,) how well two histograms agree with the second shifted by `first` bins and up to k - 1 more.

    twice: (2 n,) the one, twice in a row; (n,) the other.
    """
    for k in range(other.size):
        length = other[k]
        if length > 0.0:
            start = (k + first) % other.size
            for shift in range(likeness.size):  # the inner loop, as the compiler then turns it into vector instructions
                likeness[shift] += length * twice[start + shift]


@kernel
def peaks_of(likeness: Floats, n_peaks: int) -> tuple[Floats, Floats]:
    """Return (k,) places of the highest peaks, n_peaks at most, in bins and parts of them, and their (k,) heights."""
    n = likeness.size
    at = np.empty(n, dtype=np.int64)
    count = n - n  # 0 that is no constant
    for k in range(n):
        if likeness[k] > 0.0 and likeness[k] >= likeness[k - 1] and likeness[k] > likeness[(k + 1) % n]:
            at[count] = k
            count += 1
    n_peaks = min(n_peaks, count)
    places, heights = np.empty(n_peaks), np.empty(n_peaks)
    for p in range(n_peaks):
        best = p
        for q in range(p + 1, count):
            if likeness[at[q]] > likeness[at[best]]:
                best = q
        at[p], at[best] = at[best], at[p]
        k = at[p]
        left, right = likeness[k - 1], likeness[(k + 1) % n]
        places[p] = k + 0.5 * (left - right) / (left - 2.0 * likeness[k] + right)
        heights[p] = likeness[k]
    return places, heights


@kernel
def profiles_of(marks: Landmarks, turn: float) -> Floats:
    """Return (4, n) roots of the lengths that face along the x axis, against it, and so of y, of a scan turned."""
    found = np.zeros((4, _N_BINS))
    c, s = math.cos(turn), math.sin(turn)
    for of, is_wall in ((marks.walls, True), (marks.edges, False)):
        for i in range(of.shape[0]):
            x, y = c * of[i, MARK_X] - s * of[i, MARK_Y], s * of[i, MARK_X] + c * of[i, MARK_Y]
            fx, fy = c * of[i, FACING_X] - s * of[i, FACING_Y], s * of[i, FACING_X] + c * of[i, FACING_Y]
            if not is_wall or abs(fx) > 2.0 * abs(fy):
                add(found, 0 if fx > 0.0 else 1, x, abs(fx) if is_wall else _EDGE_LENGTH)
            if not is_wall or abs(fy) > 2.0 * abs(fx):
                add(found, 2 if fy > 0.0 else 3, y, abs(fy) if is_wall else _EDGE_LENGTH)
    return np.sqrt(found)


@inlined
def add(profiles: Floats, row: int, place: float, length: float) -> None:
    """Add a length to the two bins beside a place."""
    at = place / _BIN
    k = math.floor(at)
    profiles[row, k % _N_BINS] += (1.0 - (at - k)) * length
    profiles[row, (k + 1) % _N_BINS] += (at - k) * length


@kernel
def smoothed_twice(profiles: Floats) -> Floats:
    """Return (4, 2 n) profiles, smoothed, each twice in a row."""
    n = profiles.shape[1]
    twice = np.empty((profiles.shape[0], 2 * n))
    for row in range(profiles.shape[0]):
        for k in range(n):
            beside = profiles[row, k - 1] + profiles[row, (k + 1) % n]
            twice[row, k] = twice[row, k + n] = profiles[row, k] + 0.5 * beside
    return twice


@inlined
def is_in_sight(x: float, y: float, image: RangeImage, margin: float) -> bool:
    """Return whether a scan leaves the way from its sensor to a place free, as far as it saw."""
    j = reading_at(x, y, image)
    if j < 0:
        return True
    reach = image.surfels[j, RANGE] + margin
    return bool(x * x + y * y < reach * reach)


@kernel
def coinciding_places(turned: Floats, axis: float, marks_ref: Landmarks, marks_cur: Landmarks) -> tuple[Floats, Floats]:
    """Return (h, 2, 12) places along both axes at which walls coincide, for (h, 3) poses, and how well, falling.

    Where there are fewer, places around that of the pose follow, which count 0.
    """
    places, heights = np.empty((turned.shape[0], 2, _N_PLACES)), np.empty((turned.shape[0], 2, _N_PLACES))
    own, likeness = smoothed_twice(profiles_of(marks_ref, -axis)), np.empty(_N_SHIFTS)
    c, s = math.cos(axis), math.sin(axis)
    for h in range(turned.shape[0]):
        other = profiles_of(marks_cur, turned[h, 2] - axis)
        x, y = turned[h, 0], turned[h, 1]
        for way in range(2):
            around = c * x + s * y if way == 0 else c * y - s * x
            first = math.floor(around / _BIN) - _N_SHIFTS // 2
            likeness[:] = 0.0
            for row in (2 * way, 2 * way + 1):
                correlate(likeness, own[row], other[row], first)
            at, height = peaks_of(likeness, _N_PLACES)
            for k in range(_N_PLACES):
                if k < at.size:
                    places[h, way, k], heights[h, way, k] = (first + at[k]) * _BIN, height[k]
                else:
                    n_steps = (k - at.size + 1) // 2
                    places[h, way, k] = around + NEAR * (n_steps if (k - at.size) % 2 else -n_steps)
                    heights[h, way, k] = 0.0
    return places, heights


@kernel
def translation_hypotheses(
    first: Floats, turned: Floats, ref: RangeImage, cur: RangeImage, of_ref: Landmarks, of_cur: Landmarks, n_most: int
) -> Floats:
    """Return the `first` poses, and those with the turns of (h, 3) given ones where walls coincide along both axes.

    The n_most best are looked at. Left out are those at which one sensor would stand behind what the other saw.
    """
    axis = of_ref.axis
    places, heights = coinciding_places(turned, axis, of_ref, of_cur)
    n = first.shape[0]
    poses = np.empty((n + n_most, 3))
    for k in range(n):  # a slice would bring the text of an error to compile
        poses[k, 0], poses[k, 1], poses[k, 2] = first[k, 0], first[k, 1], first[k, 2]
    upcoming = np.zeros((turned.shape[0], _N_PLACES), dtype=np.int64)  # along the second axis, by that along the first
    for _ in range(min(n_most, turned.shape[0] * _N_PLACES * _N_PLACES)):
        most, h, i = -1.0, 0, 0
        for t in range(turned.shape[0]):
            for p in range(_N_PLACES):
                q = upcoming[t, p]
                if q < _N_PLACES and heights[t, 0, p] + heights[t, 1, q] > most:
                    most, h, i = heights[t, 0, p] + heights[t, 1, q], t, p
                if q == 0:
                    break  # those after it coincide less
        u, v = places[h, 0, i], places[h, 1, upcoming[h, i]]
        upcoming[h, i] += 1
        x, y = math.cos(axis) * u - math.sin(axis) * v, math.sin(axis) * u + math.cos(axis) * v
        theta = turned[h, 2]
        c, s = math.cos(theta), math.sin(theta)
        if is_in_sight(x, y, ref, STANDS_BEFORE) and is_in_sight(-c * x - s * y, s * x - c * y, cur, STANDS_BEFORE):
            poses[n, 0], poses[n, 1], poses[n, 2] = x, y, theta
            n += 1
    return poses[:n]
