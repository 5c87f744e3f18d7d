"""The one angle that kernels wrap; :func:`curvescan.se2.wrap` does the same for arrays."""

from __future__ import annotations

import math

from curvescan._jit import kernel


@kernel
def wrap_angle(angle: float) -> float:
    """Return an angle brought into (-pi, pi], radians; what lies inside keeps all its digits."""
    wrapped = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return math.pi if wrapped == -math.pi else wrapped
