"""Probes: the few readings of a scan that stand for all of them when many hypotheses are tried."""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.features.surfels import LENGTH, N_COLUMNS
from curvescan.types import Floats

# Share of a circle by which steps around it spread most evenly, however many there are.
_GOLDEN_SECTION = 0.5 * (math.sqrt(5) - 1.0)


@kernel
def choose_samples(surfels: Floats, n_samples: int) -> Floats:
    """Return n_samples surfels, or none if there are no lines, spread evenly over the lengths of the surfaces.

    A reading that stands for much may be chosen more than once. The first few of the samples are spread as evenly as
    all of them.
    """
    m = surfels.shape[0]
    total = 0.0
    for i in range(m):
        total += surfels[i, LENGTH]
    chosen = np.empty(n_samples, dtype=np.int64)
    count = 0
    reached = 0.0
    for i in range(m):
        length = surfels[i, LENGTH]
        reached += length
        while count < n_samples and length > 0.0 and reached * n_samples >= (count + 0.5) * total:
            chosen[count] = i
            count += 1
    # a stride near the golden section that shares no factor with the count visits each one once
    stride = max(int(_GOLDEN_SECTION * count), 1)
    while math.gcd(stride, max(count, 1)) != 1:
        stride += 1
    samples = np.empty((count, N_COLUMNS))
    k = 0
    for i in range(count):
        for column in range(N_COLUMNS):
            samples[i, column] = surfels[chosen[k], column]
        k = (k + stride) % count
    return samples
