"""The one place that names Numba's flags.

``error_model="numpy"`` keeps NaN and division semantics; ``fastmath`` stays off because under it ``isnan`` is always
False and a missing reading would pass for a measurement.
"""

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core import event

from curvescan._compilation import watch
from curvescan._kernel_cache import KernelCache

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


def _compiled(function: Callable[_P, _R], **flags: str) -> Callable[_P, _R]:
    compiled: Any = function
    if not _numba_config.DISABLE_JIT:
        compiled = _njit(**flags)(function)
        compiled._cache = KernelCache(function)
    _kernels.append(compiled)
    typed: Callable[_P, _R] = compiled
    return typed


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
