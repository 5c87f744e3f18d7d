"""Rows: an array that grows by half, so that appending to it stays cheap."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from curvescan.types import Bools


class Rows:
    """An array of rows of one shape and type."""

    def __init__(self, shape: tuple[int, ...] = (), dtype: DTypeLike = np.float64) -> None:
        self._room: NDArray[Any] = np.empty((16, *shape), dtype)
        self._n = 0

    def __len__(self) -> int:
        return self._n

    @property
    def array(self) -> NDArray[Any]:
        """The rows, a view."""
        return self._room[: self._n]

    def append(self, row: Any) -> None:
        """Append a row; of a structured type a tuple of its fields."""
        if self._n == len(self._room):
            self._room = np.concatenate((self._room, np.empty_like(self._room[: self._n // 2])))
        self._room[self._n] = row
        self._n += 1

    def keep(self, is_kept: Bools) -> None:
        """Remove the rows that are not kept; the others keep their order."""
        kept = self.array[is_kept]
        self._n = len(kept)
        self.array[:] = kept
