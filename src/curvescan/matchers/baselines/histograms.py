"""Histograms of angles and of coordinates, and where two of them agree best (Weiss and v. Puttkamer 1995).

G. Weiss, E. v. Puttkamer, "A map based on laserscans without geometric interpretation", Intelligent Autonomous
Systems 4 (1995).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from curvescan.types import Floats


@dataclass(frozen=True, kw_only=True)
class Peak:
    """Where two histograms agree best."""

    lag: float  # bins by which the second must be moved up to agree with the first, between bins by a parabola
    agreement: float  # correlation coefficient there, 0 to 1
    width: float  # standard deviation of the peak taken as a bell, bins; inf where it is no peak


def ring_histogram(positions: Floats, weights: Floats, n_bins: int, smoothing: float) -> Floats:
    """Return a histogram on a ring, each entry shared by two bins, smoothed by a bell.

    positions (n,); weights (n,); result (n_bins,).
    """
    lower = np.floor(positions)
    share = positions - lower
    bins = lower.astype(np.int64) % n_bins
    histogram = np.bincount(bins, weights * (1.0 - share), n_bins)
    histogram += np.bincount((bins + 1) % n_bins, weights * share, n_bins)
    frequencies = np.arange(n_bins // 2 + 1) * (2.0 * math.pi / n_bins)
    bell = np.exp(-0.5 * (smoothing * frequencies) ** 2)
    return np.fft.irfft(np.fft.rfft(histogram) * bell, n_bins)


def best_lag(first: Floats, second: Floats, centre: float, reach: float) -> Peak | None:
    """Return the lag, within a window, at which the second histogram agrees best with the first.

    first, second (n,); Peak or None: None where a histogram is empty, or the best lag is the window's border and so
    no peak.
    """
    n = first.size
    norm = math.sqrt(float(first @ first) * float(second @ second))
    if norm <= 0.0:
        return None
    correlation = np.fft.irfft(np.fft.rfft(first) * np.conj(np.fft.rfft(second)), n)
    reach = min(reach, n / 2 - 1)
    lags = np.arange(math.ceil(centre - reach), math.floor(centre + reach) + 1)
    values = correlation[lags % n]
    best = int(np.argmax(values))
    before, top, after = correlation[(lags[best] + np.array([-1, 0, 1])) % n]
    if max(before, after) > top:
        return None
    bend = before - 2.0 * top + after
    shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return Peak(
        lag=float(lags[best] + shift),
        agreement=float(top / norm),
        width=math.sqrt(-top / bend) if bend < 0.0 else math.inf,
    )
