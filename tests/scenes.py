"""Small scenes made by hand, for tests that must not lean on the simulator they would also test."""

from __future__ import annotations

import math

import numpy as np

from curvescan import LaserScan

ROOM = (-2.0, -1.5, 3.0, 2.5)  # x_min, y_min, x_max, y_max


def room_ranges(pose, angles, room=ROOM):
    """Exact ranges in a rectangular room from a pose inside it."""
    x, y, theta = pose
    c, s = np.cos(angles + theta), np.sin(angles + theta)
    with np.errstate(divide="ignore"):
        to_x = np.where(c > 0, room[2] - x, room[0] - x) / c
        to_y = np.where(s > 0, room[3] - y, room[1] - y) / s
    return np.minimum(np.where(c == 0, np.inf, to_x), np.where(s == 0, np.inf, to_y))


def room_scan(pose=(0.0, 0.0, 0.0), *, sigma=0.0, seed=0, n_beams=361, fov=math.pi, **kwargs):
    """One sweep of a half-circle sensor in the room, with Gaussian range noise of `sigma` metres."""
    increment = fov / (n_beams - 1)
    angles = -fov / 2 + increment * np.arange(n_beams)
    noise = sigma * np.random.default_rng(seed).standard_normal(n_beams)
    return LaserScan(
        room_ranges(pose, angles) + noise, angle_min=-fov / 2, angle_increment=increment, range_max=20.0, **kwargs
    )


def rough_polyline(seed, n=40, spacing=0.05, n_corners=3, sigma=0.003):
    """(n, 2) points along a line with corners and noise, as a segment of a scan would be."""
    rng = np.random.default_rng(seed)
    turns = np.zeros(n)
    turns[rng.choice(np.arange(3, n - 3), size=n_corners, replace=False)] = rng.uniform(-2.0, 2.0, n_corners)
    heading = rng.uniform(-math.pi, math.pi) + np.cumsum(turns)
    steps = spacing * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return np.cumsum(steps, axis=0) + sigma * rng.standard_normal((n, 2))
