"""Normal equations over x, y and theta: where their sums stand in a flat array, and how one residual is added."""

from __future__ import annotations

from curvescan._jit import inlined
from curvescan.types import Floats

# Columns: the upper triangle of the information, and the gradient.
XX, XY, XT, YY, YT, TT, GRADIENT_X, GRADIENT_Y, GRADIENT_T = range(9)
N_TRIANGLE = TT + 1
N_SUMS = GRADIENT_T + 1


@inlined
def add_square(system: Floats, first: int, weight: float, jx: float, jy: float, jt: float) -> None:
    """Add to the triangle that starts at column `first` the information of one residual with the given derivatives."""
    wx, wy = weight * jx, weight * jy
    system[first + XX] += wx * jx
    system[first + XY] += wx * jy
    system[first + XT] += wx * jt
    system[first + YY] += wy * jy
    system[first + YT] += wy * jt
    system[first + TT] += weight * jt * jt
