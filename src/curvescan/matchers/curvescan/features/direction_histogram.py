"""The histogram of the directions of all surfaces, which turns with the sensor (Weiss and von Puttkamer 1995)."""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.features.range_image import bearing
from curvescan.matchers.curvescan.features.surfels import LENGTH, NX, NY
from curvescan.types import Floats

# Bins of the histogram: of 3 degrees, which smoothing and a parabola through the best shift make finer.
N_DIRECTIONS = 120
_LEAST_NORM2 = 1e-12  # square metres, so that a scan without surfaces is not divided by zero


@kernel
def direction_histogram(surfels: Floats) -> Floats:
    """Return (120,) the length of surface that faces each direction, smoothed, of unit norm."""
    counts = np.zeros(N_DIRECTIONS)
    places = np.empty(surfels.shape[0])
    for i in range(places.size):  # in a loop of its own, which the compiler turns into vector instructions
        places[i] = (bearing(surfels[i, NX], surfels[i, NY]) + math.pi) * float(N_DIRECTIONS) / (2.0 * math.pi)
    for i in range(places.size):
        k = min(int(places[i]), N_DIRECTIONS - 1)
        share = places[i] - k
        counts[k] += (1.0 - share) * surfels[i, LENGTH]
        counts[k + 1 if k < N_DIRECTIONS - 1 else 0] += share * surfels[i, LENGTH]
    smooth = np.empty(N_DIRECTIONS)
    total = _LEAST_NORM2
    for k in range(N_DIRECTIONS):
        smooth[k] = counts[k - 1] + 2.0 * counts[k] + counts[(k + 1) % N_DIRECTIONS]
        total += smooth[k] * smooth[k]
    return smooth / math.sqrt(total)
