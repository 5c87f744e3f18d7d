"""The histogram of the directions of all surfaces, which turns with the sensor (Weiss and von Puttkamer 1995)."""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.features.range_image import bearing
from curvescan.matchers.curvescan.features.surfels import LENGTH, NX, NY
from curvescan.types import Floats


@kernel
def direction_histogram(surfels: Floats) -> Floats:
    """Return (120,) the length of surface that faces each direction, smoothed, of unit norm."""
    counts = np.zeros(120)
    for i in range(surfels.shape[0]):
        place = (bearing(surfels[i, NX], surfels[i, NY]) + math.pi) * 120.0 / (2.0 * math.pi)
        k = min(int(place), 119)
        share = place - k
        counts[k] += (1.0 - share) * surfels[i, LENGTH]
        counts[k + 1 if k < 119 else 0] += share * surfels[i, LENGTH]
    smooth = np.empty(120)
    total = 1e-12
    for k in range(120):
        smooth[k] = counts[k - 1] + 2.0 * counts[k] + counts[(k + 1) % 120]
        total += smooth[k] * smooth[k]
    return smooth / math.sqrt(total)
