"""The one place that names Numba's flags.

``error_model="numpy"`` keeps NaN and division semantics; ``fastmath`` stays off because under it
``isnan`` is always False and a missing reading would pass for a measurement. ``cache=True`` stores the
machine code on disk so that only the first run compiles; see :mod:`curvescan._kernel_cache`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core import event
from numba.core.registry import CPUDispatcher

from curvescan._compilation import watch
from curvescan._kernel_cache import ForgivingCache, cache_folder, numba_caches_in

_P = ParamSpec("_P")
_R = TypeVar("_R")

# a C wrapper of each kernel, which nobody calls, would take a fourteenth of the time
_njit: Any = functools.partial(numba.njit, error_model="numpy", no_cfunc_wrapper=True, nogil=True)
_numba_config: Any = numba.config

_kernels: list[Any] = []


def kernel(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Return `function` compiled on its first call, machine code cached on disk."""
    return _compiled(function)


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Return a `kernel` of a few operations that is compiled as part of each kernel that calls it.

    Alone it would take a tenth of a second to compile, whatever it does; so it is compiled alone only where Python
    calls it.
    """
    return _compiled(function, inline="always")


def n_compiled() -> int:
    """Return how many kernel variants this process had to compile because no cached code was found.

    Always 0 with NUMBA_DISABLE_JIT=1.
    """
    compiled = [k for k in _kernels if isinstance(k, CPUDispatcher)]
    return sum(sum(k.stats.cache_misses.values()) for k in compiled)


def _compiled(function: Callable[_P, _R], **flags: str) -> Callable[_P, _R]:
    compiled = function if _numba_config.DISABLE_JIT else _dispatcher(function, **flags)
    _kernels.append(compiled)
    typed: Callable[_P, _R] = compiled
    return typed


def _dispatcher(function: Callable[..., Any], **flags: str) -> Any:
    folder = cache_folder()
    if folder is not None:
        with numba_caches_in(folder):
            cached = _njit(cache=True, **flags)(function)
        # a Numba that keeps the code anywhere else may bring back that of another version
        if folder in Path(cached.stats.cache_path).parents:
            cached._cache = ForgivingCache(cached._cache)
            return cached
    uncached = _njit(**flags)(function)
    uncached._cache = ForgivingCache(uncached._cache)
    return uncached


class _Listener(event.Listener):
    """Passes on when a kernel of this package, and of no other, is compiled."""

    def on_start(self, event: Any) -> None:
        if _is_kernel(event.data["dispatcher"]):
            watch.start()

    def on_end(self, event: Any) -> None:
        if _is_kernel(event.data["dispatcher"]):
            watch.end()


def _is_kernel(dispatcher: Any) -> bool:
    return any(dispatcher is one for one in _kernels)


_register: Any = event.register
_register("numba:compile", _Listener())
