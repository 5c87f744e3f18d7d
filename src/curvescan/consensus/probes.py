"""Probes: the few readings of a scan that stand for all of them when many hypotheses are tried."""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.types import Floats


@kernel
def choose_probes(surfels: Floats, step: float, n_probes: int) -> Floats:
    """Return n_probes surfels, or none if there are no lines, spread evenly over the lengths of the surfaces.

    A reading stands for the length of surface between it and its neighbours, but for no more than 0.3 m
    and for no less than 0.03 m: near surfaces, which are dense, do not take all, nor far ones. A reading that stands for much may be chosen more than once. The first few of the
    probes are spread as evenly as all of them.
    """
    m = surfels.shape[0]
    weight = np.zeros(m)
    total = 0.0
    for i in range(m):
        if surfels[i, 7] < 0.0:
            continue  # holds no line
        r = surfels[i, 2]
        facing = abs(surfels[i, 5] * surfels[i, 0] + surfels[i, 6] * surfels[i, 1]) / r
        weight[i] = min(max(r * step / max(facing, 0.1), 0.03), 0.3)
        total += weight[i]
    chosen = np.empty(n_probes, dtype=np.int64)
    count = 0
    reached = 0.0
    for i in range(m):
        reached += weight[i]
        while count < n_probes and weight[i] > 0.0 and reached * n_probes >= (count + 0.5) * total:
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
