"""Correlation of circular histograms, and its highest peaks."""

from __future__ import annotations

import numpy as np

from curvescan._jit import kernel
from curvescan.types import Floats


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
