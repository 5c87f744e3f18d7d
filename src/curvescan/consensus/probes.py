"""Probes: the few readings of a scan that stand for all of them when many hypotheses are tried."""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.types import Floats


@kernel
def choose_probes(surfels: Floats, step: float, n_few: int, n_many: int) -> tuple[Floats, Floats]:
    """Return n_few and n_many surfels, or none if there are no lines, spread evenly over the lengths of the surfaces.

    A reading stands for the length of surface between it and its neighbours, but for no more than 0.3 m and for no less
    than 0.03 m: near surfaces, which are dense, do not take all, nor far ones. A reading that stands for much may be
    chosen more than once. The first few of the probes are spread as evenly as all of them.
    """
    m = surfels.shape[0]
    reached = np.zeros(m + 1)  # length of all surfaces before each reading
    for i in range(m):
        reached[i + 1] = reached[i]
        if surfels[i, 7] < 0.0:
            continue  # holds no line
        r = surfels[i, 2]
        facing = abs(surfels[i, 5] * surfels[i, 0] + surfels[i, 6] * surfels[i, 1]) / r
        reached[i + 1] += min(max(r * step / max(facing, 0.1), 0.03), 0.3)
    return _spread(surfels, reached, n_few), _spread(surfels, reached, n_many)


@kernel
def _spread(surfels: Floats, reached: Floats, n_probes: int) -> Floats:
    m = surfels.shape[0]
    chosen = np.empty(n_probes, dtype=np.int64)
    count = 0
    for i in range(m):
        while (
            count < n_probes
            and reached[i + 1] > reached[i]
            and reached[i + 1] * n_probes >= (count + 0.5) * reached[m]
        ):
            chosen[count] = i
            count += 1
    # a stride near the golden section that shares no factor with the count visits each one once
    stride = max(int(0.618 * count), 1)
    while math.gcd(stride, max(count, 1)) != 1:
        stride += 1
    probes = np.empty((count, surfels.shape[1]))
    k = 0
    for i in range(count):
        for column in range(surfels.shape[1]):
            probes[i, column] = surfels[chosen[k], column]
        k = (k + stride) % count
    return probes
