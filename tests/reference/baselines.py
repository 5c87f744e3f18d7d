"""The rivals' stages written down slowly, for the fast ones to be compared with.

Every point against every other, no walk, no early end; nothing here is shared with the package.
"""

from __future__ import annotations

import math

import numpy as np


def apart(a, b):
    """Absolute angle between two bearings."""
    return abs((a - b + math.pi) % (2 * math.pi) - math.pi)


def local_line(points, i, arm):
    """Direction of the line through the readings of one surface near reading i, by singular values."""
    first = last = i
    while first > 0 and (first == i or math.dist(points[first - 1], points[i]) <= arm):
        first -= 1
    while last < len(points) - 1 and (last == i or math.dist(points[last + 1], points[i]) <= arm):
        last += 1
    near = points[first : last + 1]
    direction = np.linalg.svd(near - near.mean(axis=0))[2][0]
    return direction if direction @ (near[-1] - near[0]) >= 0 else -direction


def nearest_reading(point, ref_points, max_distance):
    squared = ((ref_points - point) ** 2).sum(axis=1)
    best = int(np.argmin(squared))
    return (best, squared[best]) if squared[best] <= max_distance**2 else (-1, math.inf)


def on_stretch(point, a, b):
    along = b - a
    length = along @ along
    share = min(max((point - a) @ along / length, 0.0), 1.0) if length > 0 else 0.0
    return a + share * along


def closest_point(point, ref_points, is_joined, max_distance):
    """Closest point of all stretches, window open all around."""
    n = len(ref_points)
    best, partner = math.inf, np.full(2, math.nan)
    for k in range(n):
        q = on_stretch(point, ref_points[k], ref_points[(k + 1) % n] if is_joined[k] else ref_points[k])
        squared = float((q - point) @ (q - point))
        if squared < best:
            best, partner = squared, q
    return (partner, best) if best <= max_distance**2 else (np.full(2, math.nan), math.inf)


def matching_range_candidates(point, ref_points, is_joined):
    """Every point of the stretches where their range, linear between two readings, is the point's own."""
    n, rho = len(ref_points), math.hypot(*point)
    found = []
    for k in range(n):
        if not is_joined[k]:
            continue
        a, b = ref_points[k], ref_points[(k + 1) % n]
        here, there = math.hypot(*a) - rho, math.hypot(*b) - rho
        if here * there <= 0:
            share = here / (here - there) if here != there else 0.0
            found.append(a + share * (b - a))
    return found


def fit(points):
    """Centre, direction and greatest normal distance of a total least squares line, by singular values."""
    centre = points.mean(axis=0)
    direction = np.linalg.svd(points - centre)[2][0]
    across = (points - centre) @ np.array([-direction[1], direction[0]])
    return centre, direction, np.abs(across).max()


def split(points, start, stop, max_error):
    """Ramer's iterative end point fit, recursively: list of (start, stop); a split reading ends its stretch."""
    a, chord = points[start], points[stop - 1] - points[start]
    length = math.hypot(*chord)
    worst, at = 0.0, start
    for k in range(start + 1, stop - 1):
        away = points[k] - a
        distance = abs(chord[0] * away[1] - chord[1] * away[0]) / length if length else math.hypot(*away)
        if distance > worst:
            worst, at = distance, k
    if worst <= max_error:
        return [(start, stop)]
    return split(points, start, at + 1, max_error) + split(points, at + 1, stop, max_error)


def split_and_merge(points, surfaces, max_error):
    lines = []
    for start, stop in surfaces:
        own = []
        for piece in split(points, start, stop, max_error):
            if own and fit(points[own[-1][0] : piece[1]])[2] <= max_error:
                piece = (own.pop()[0], piece[1])
            own.append(piece)
        lines += own
    return lines


def normal_distances(pose, points, anchors, normals):
    x, y, theta = pose
    c, s = math.cos(theta), math.sin(theta)
    moved = points @ np.array([[c, s], [-s, c]]) + [x, y]
    return ((moved - anchors) * normals).sum(axis=1)


def can_be_seen(points, is_joined, i, margin):
    """Whether nothing that faces the origin stands before reading i, and its own surface does not face away."""
    n = len(points)
    bearing = np.arctan2(points[:, 1], points[:, 0])
    reach = np.hypot(points[:, 0], points[:, 1])

    def turn(k):
        return (bearing[(k + 1) % n] - bearing[k] + math.pi) % (2 * math.pi) - math.pi

    own = [k for k in (i, (i - 1) % n) if is_joined[k]]
    if len(own) == 2 and all(turn(k) < 0 for k in own):
        return False
    for k in range(n):
        if is_joined[k] and turn(k) > 0:
            share = ((bearing[i] - bearing[k] + math.pi) % (2 * math.pi) - math.pi) / turn(k)
            if 0 <= share <= 1:
                there = reach[k] + share * (reach[(k + 1) % n] - reach[k])
                if there < reach[i] - margin:
                    return False
    return True
