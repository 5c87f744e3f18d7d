"""Probes: the few readings of a scan that stand for all of them when many hypotheses are tried."""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.consensus.surfels import LENGTH, N_COLUMNS
from curvescan.types import Floats


@kernel
def choose_probes(surfels: Floats, n_few: int, n_many: int) -> tuple[Floats, Floats]:
    """Return n_few and n_many surfels, or none if there are no lines, spread evenly over the lengths of the surfaces.

    A reading that stands for much may be chosen more than once. The first few of the probes are spread as evenly as all
    of them.
    """
    m = surfels.shape[0]
    before = np.zeros(m + 1)  # length of all surfaces before each reading
    for i in range(m):
        before[i + 1] = before[i] + surfels[i, LENGTH]
    return _spread(surfels, before, n_few), _spread(surfels, before, n_many)


@kernel
def _spread(surfels: Floats, before: Floats, n_probes: int) -> Floats:
    m = surfels.shape[0]
    chosen = np.empty(n_probes, dtype=np.int64)
    count = 0
    for i in range(m):
        while (
            count < n_probes
            and surfels[i, LENGTH] > 0.0
            and before[i + 1] * n_probes >= (count + 0.5) * before[m]
        ):
            chosen[count] = i
            count += 1
    # a stride near the golden section that shares no factor with the count visits each one once
    stride = max(int(0.618 * count), 1)
    while math.gcd(stride, max(count, 1)) != 1:
        stride += 1
    probes = np.empty((count, N_COLUMNS))
    k = 0
    for i in range(count):
        for column in range(N_COLUMNS):
            probes[i, column] = surfels[chosen[k], column]
        k = (k + stride) % count
    return probes
