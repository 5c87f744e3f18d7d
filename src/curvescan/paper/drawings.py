"""Drawings of what the equations mean: eqs. 2 and 3 (the paper's figure 2), a curvature function (its figure 3)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.matchers.cfsma.curvature import curvature_functions
from curvescan.matchers.cfsma.landmarks import characteristic_points
from curvescan.plots.canvas import DARK, GREY, LIGHT, PATH, TRUTH, drawing
from curvescan.types import Points


def draw_geometry(path: Path) -> None:
    """Save the limit of eq. 2 between two beams, and arc and chord of eq. 3 around a corner."""
    with drawing(path, 11.0, 4.2) as figure:
        left, right = figure.subplots(1, 2)
        before, step, incidence = 3.0, np.radians(12.0), np.radians(28.0)
        first = before * np.array([np.cos(0.2), np.sin(0.2)])
        # law of sines: a surface met at the limiting incidence by both beams
        gap = before * np.sin(step) / np.sin(incidence - step)
        away = 0.2 + incidence
        second = first + gap * np.array([np.cos(away), np.sin(away)])
        for point, name in ((first, "l - 1"), (second, "l")):
            left.plot([0.0, point[0]], [0.0, point[1]], color=GREY, lw=1.0)
            left.annotate(name, point, textcoords="offset points", xytext=(6, -10))
        left.plot(*np.array([first, second]).T, "o-", color=DARK, lw=1.6)
        left.plot(0.0, 0.0, "s", color=PATH, ms=7)
        left.annotate("dphi", (1.0, 0.33), color=PATH)
        left.annotate("lambda", first + np.array([0.35, 0.16]), color=PATH)
        left.annotate("rho", 0.55 * first - np.array([0.0, 0.18]), color=PATH)
        left.set_title("eq. 2: a longer gap, by 3 sigma_rho, is a breakpoint")
        walk = np.array([[0.1 * k, 0.0] for k in range(9)] + [[0.8, 0.1 * k] for k in range(1, 8)])
        right.plot(*walk.T, "o-", color=DARK, ms=4, lw=1.0, label="readings")
        right.plot(*walk[3:13].T, "o-", color=LIGHT, ms=5, lw=2.4, label="arc, from l to l + k")
        right.plot(*walk[[3, 12]].T, "--", color=PATH, lw=1.6, label="chord, its direction is theta_l")
        right.set_title("eq. 3: k grows while arc - chord < U_k")
        right.legend()
        for axes in (left, right):
            axes.set_aspect("equal", adjustable="datalim")
            axes.set(xlabel="x [m]", ylabel="y [m]")


def draw_curvature(path: Path, *, sigma: float = 0.003, seed: int = 0) -> None:
    """Save a segment of two corners and its curvature function, with U_p and the characteristic points."""
    config = CfSmaConfig()
    points = _segment(sigma, seed)
    starts, stops = np.array([0]), np.array([len(points)])
    eta, _ = curvature_functions(points, starts, stops, config.curvature)
    peaks = characteristic_points(eta, starts, stops, config.landmarks).extents[:, 0]
    with drawing(path, 11, 4) as figure:
        left, right = figure.subplots(1, 2)
        left.plot(*points.T, ".", color=DARK, ms=4)
        left.plot(*points[peaks].T, "o", color="none", mec=PATH, mew=1.6, ms=9)
        left.set_aspect("equal", adjustable="datalim")
        left.set(xlabel="x [m]", ylabel="y [m]", title="a segment and its characteristic points")
        right.plot(eta, color=DARK, lw=1.0)
        right.plot(peaks, eta[peaks], "o", color="none", mec=PATH, mew=1.6, ms=9)
        for sign in (-1.0, 1.0):
            level = sign * config.landmarks.min_curvature
            right.axhline(level, color=TRUTH, ls="--", lw=1.0)
        right.annotate("U_p", (2, config.landmarks.min_curvature + 0.01), color=TRUTH)
        right.set(xlabel="reading l", ylabel="eta [rad]", title="its curvature function (eq. 5)")


def _segment(sigma: float, seed: int) -> Points:
    """Return readings 3 cm apart along a wall, round a corner to the left, and round one to the right."""
    steps = np.repeat([[0.03, 0.0], [0.0, 0.03], [0.03, 0.0]], 40, axis=0)
    noise = sigma * np.random.default_rng(seed).standard_normal((len(steps), 2))
    points: Points = np.cumsum(steps, axis=0) + noise
    return points
