"""The one place that names Numba's flags.

``error_model="numpy"`` keeps NaN and division semantics; ``fastmath`` stays off because under it
``isnan`` is always False and a missing reading would pass for a measurement. ``cache=True`` stores the
machine code on disk so that only the first run compiles.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core.registry import CPUDispatcher

_P = ParamSpec("_P")
_R = TypeVar("_R")

_kernels: list[Any] = []


def kernel(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Return `function` compiled on its first call, machine code cached on disk.

    Parameters
    ----------
    function
        Takes contiguous arrays and scalars, returns a scalar, an array or a tuple of them. It neither
        validates nor raises.
    """
    compiled = numba.njit(cache=True, error_model="numpy", nogil=True)(function)
    _kernels.append(compiled)
    typed: Callable[_P, _R] = compiled
    return typed


def n_compiled() -> int:
    """Return how many kernel variants this process had to compile because no cached code was found.

    Always 0 with NUMBA_DISABLE_JIT=1.
    """
    compiled = [k for k in _kernels if isinstance(k, CPUDispatcher)]
    return sum(sum(k.stats.cache_misses.values()) for k in compiled)
