"""Which pose of one trajectory belongs to which of another, by their time stamps.

Real stamps are neither sorted nor unique: they go back, repeat, and in some files they are printed with so few digits
that they say nothing. File order is kept throughout.
"""

from __future__ import annotations

from collections import defaultdict, deque
from dataclasses import dataclass
from typing import Literal

import numpy as np

from curvescan.errors import InvalidArgumentError
from curvescan.types import Floats, Ints


@dataclass(frozen=True, eq=False, kw_only=True)
class Association:
    """Pairs of poses taken at the same time, each pose in at most one pair."""

    # (n,): indices into the two trajectories, in the order of the first
    first: Ints
    second: Ints
    n_exact: int  # pairs whose stamps are equal to the last digit
    by: Literal["stamp", "order"]  # by what they were associated

    def __len__(self) -> int:
        return len(self.first)


def associate(first: Floats, second: Floats, *, tolerance: float = 0.01) -> Association:
    """Return the pairs of two lists of stamps, equal stamps first, then the nearest within a tolerance.

    Equal stamps that repeat are paired in their order. Of the others, each pair of stamps within the tolerance is a
    candidate, and the nearest are taken first. Where more than half of the stamps of a list repeat, stamps say
    nothing: the lists are then paired in their order, if they are equally long.

    first, second (n,). Raises InvalidArgumentError.
    """
    if _says_nothing(first) or _says_nothing(second):
        if len(first) != len(second):
            raise InvalidArgumentError(
                "most time stamps repeat, so poses can only be paired in their order, which needs equally many: "
                f"got {len(first):,} and {len(second):,}"
            )
        order = np.arange(len(first))
        n_exact = int(np.count_nonzero(first == second))
        return Association(first=order, second=order, n_exact=n_exact, by="order")
    pairs = _equal_pairs(first, second)
    n_exact = len(pairs)
    pairs += _near_pairs(first, second, pairs, tolerance)
    table = np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)
    return Association(first=table[:, 0], second=table[:, 1], n_exact=n_exact, by="stamp")


def find_stamps(stamps: Floats, wanted: Floats, *, tolerance: float = 1e-4) -> Ints:
    """Return where each wanted stamp stands: an equal one first, else the nearest within a tolerance.

    stamps (n,); wanted (m,); result (m,): Indices into `stamps`; -1 where there is no such stamp, or several equal
    ones: no telling which is meant.
    """
    if len(stamps) == 0:
        return np.full(len(wanted), -1)
    order = np.argsort(stamps, kind="stable")
    ordered = stamps[order]
    right = np.clip(np.searchsorted(ordered, wanted), 0, len(ordered) - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(wanted - ordered[left] < ordered[right] - wanted, left, right)
    off = np.abs(ordered[nearest] - wanted)
    value = ordered[nearest]
    n_equal = np.searchsorted(ordered, value, "right") - np.searchsorted(ordered, value, "left")
    found: Ints = np.where((off <= tolerance) & (n_equal == 1), order[nearest], -1)
    return found


def _says_nothing(stamps: Floats) -> bool:
    return len(np.unique(stamps)) * 2 < len(stamps)


def _equal_pairs(first: Floats, second: Floats) -> list[tuple[int, int]]:
    places: dict[float, deque[int]] = defaultdict(deque)
    for j, stamp in enumerate(second.tolist()):
        places[stamp].append(j)
    return [(i, places[stamp].popleft()) for i, stamp in enumerate(first.tolist()) if places.get(stamp)]


def _near_pairs(first: Floats, second: Floats, taken: list[tuple[int, int]], tolerance: float) -> list[tuple[int, int]]:
    """Return pairs of what is not taken yet, nearest first."""
    free = np.setdiff1d(np.arange(len(first)), [i for i, _ in taken])
    others = np.setdiff1d(np.arange(len(second)), [j for _, j in taken])
    others = others[np.argsort(second[others], kind="stable")]
    low = np.searchsorted(second[others], first[free] - tolerance, "left")
    high = np.searchsorted(second[others], first[free] + tolerance, "right")
    candidates = sorted(
        (abs(first[i] - second[j]), int(i), int(j))
        for i, start, stop in zip(free, low, high, strict=True)
        for j in others[start:stop]
    )
    pairs: list[tuple[int, int]] = []
    used_first: set[int] = set()
    used_second: set[int] = set()
    for _, i, j in candidates:
        if i not in used_first and j not in used_second:
            used_first.add(i)
            used_second.add(j)
            pairs.append((i, j))
    return pairs
