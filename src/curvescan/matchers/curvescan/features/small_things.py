"""Small things: how large a surface shows, and how far it stands before what is beside it, as people and chairs do."""

from __future__ import annotations

from curvescan._jit import kernel
from curvescan.matchers.curvescan.features.surfels import RANGE, X, Y
from curvescan.types import Floats, Ints

PERSON_EXTENT = 0.6  # metres: no person shows more

_OPEN = 1.0  # metres: nothing is seen beside the first and the last surface


@kernel
def extent_and_steps(surfels: Floats, bounds: Ints, k: int) -> tuple[float, float, float]:
    """Return how large surface k is and how far it stands before its neighbours."""
    first, last = bounds[k], bounds[k + 1] - 1
    extent2 = 0.0
    for i in range(first, last + 1):
        dx, dy = surfels[i, X] - surfels[first, X], surfels[i, Y] - surfels[first, Y]
        extent2 = max(extent2, dx * dx + dy * dy)
    before = surfels[first - 1, RANGE] - surfels[first, RANGE] if first > 0 else _OPEN
    behind = surfels[last + 1, RANGE] - surfels[last, RANGE] if last + 1 < surfels.shape[0] else _OPEN
    return extent2, before, behind
