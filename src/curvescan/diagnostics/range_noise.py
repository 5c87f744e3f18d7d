"""How the noise of a laser grows with the range: little where light is timed, a lot where it is triangulated.

One scan does not tell it from clutter, which is far as well; a log does. Neighbouring readings on one line lie off it
by their noise alone.
"""

import math
from collections.abc import Iterable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from curvescan.scan import LaserScan
from curvescan.types import Floats

_N_SIDE_BY_SIDE = 5  # readings that make a line
_LEAST_FACING = 0.5  # cosine of the incidence: on flatter ones range noise leads along the line
_N_BANDS, _LEAST_READINGS = 8, 1_000  # bands of range, as many readings in each; lines that tell it
_QUANTILE = 0.4  # of the lines of a band: clutter raises many
_LEAST_VARIANCE = 1e-8  # square metres: what is rounded can lie on a line exactly
# metres: what clutter feigns takes longer, 3.2 m and more in ten logs of lasers that time light
_GROWS_WITHIN, _LEAST = 2.0, 0.25


def noise_doubled_at(scans: Iterable[LaserScan]) -> float:
    """Return the range at which the variance of the noise is twice that at the sensor, metres; inf where none is."""
    lines = [_lines_of(scan) for scan in scans]
    ranges, variances = np.concatenate([np.empty((2, 0)), *lines], axis=1)
    if ranges.size < _LEAST_READINGS:
        return math.inf
    bands = np.array_split(np.argsort(ranges, kind="stable"), _N_BANDS)
    squares = np.array([np.mean(ranges[band] ** 2) for band in bands])
    if squares[-1] < 2.0 * squares[0]:  # all lie as far away
        return math.inf
    noise = np.array([np.quantile(variances[band], _QUANTILE) for band in bands]).clip(_LEAST_VARIANCE)
    growth, at_sensor = np.polyfit(squares, noise, 1, w=1.0 / noise)
    if at_sensor >= growth * _GROWS_WITHIN**2:
        return math.inf
    return max(math.sqrt(max(at_sensor, 0.0) / growth), _LEAST)


def _lines_of(scan: LaserScan) -> Floats:
    """Return (2, m) the range of lines through neighbouring readings, and the variance of the ranges along them."""
    if len(scan) < _N_SIDE_BY_SIDE:
        return np.empty((2, 0))
    is_whole = sliding_window_view(scan.valid, _N_SIDE_BY_SIDE).all(axis=1)
    points = sliding_window_view(scan.points, _N_SIDE_BY_SIDE, axis=0)[is_whole]  # (m, 2, 5)
    centres = points.mean(axis=2)
    x, y = (points - centres[:, :, np.newaxis]).transpose(1, 0, 2)
    xx, yy, xy = np.mean(x * x, axis=1), np.mean(y * y, axis=1), np.mean(x * y, axis=1)
    across = np.maximum(0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy), 0.0)
    along = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    ranges = np.hypot(*centres.T)
    facing = (np.cos(along) * centres[:, 1] - np.sin(along) * centres[:, 0]) / np.maximum(ranges, 1e-9)
    is_faced = np.abs(facing) > _LEAST_FACING
    return np.stack([ranges[is_faced], across[is_faced] / facing[is_faced] ** 2])
