"""Errors of a trajectory against relations, the measure of the Freiburg SLAM benchmark; stamps that are matched.

R. Kümmerle et al., "On measuring the accuracy of SLAM algorithms", Autonomous Robots 27 (2009): the error of relation
(i, j) is the motion from the true relative pose to the estimated one; its translation and its rotation are reported
separately. Near relations, between scans a few seconds apart, measure the matching; far ones, between visits of one
place, measure what has added up in between, which a trajectory without loop closing cannot avoid.
"""

from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.configs import look_up, shipped_table
from curvescan.errors import InvalidArgumentError
from curvescan.evaluation.trajectory_errors import Spread, travelled
from curvescan.io.trajectories.relations import Relations, read_relations
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.types import Bools, Floats, Ints

__all__ = ["RelationErrors", "Relations", "Which", "read_relations", "relation_errors"]


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
    """Return the pairs of two lists of stamps (n,): equal stamps first, then the nearest within a tolerance.

    Where more than half of the stamps of a list repeat, lists of one length are paired in their order. Raises
    InvalidArgumentError.
    """
    # where most stamps repeat they say nothing
    if any(len(np.unique(stamps)) * 2 < len(stamps) for stamps in (first, second)):
        if len(first) != len(second):
            raise InvalidArgumentError(
                "most time stamps repeat, so poses can only be paired in their order, which needs equally many: "
                f"got {len(first):,} and {len(second):,}"
            )
        order = np.arange(len(first))
        n_exact = int(np.count_nonzero(first == second))
        return Association(first=order, second=order, n_exact=n_exact, by="order")
    places: dict[float, deque[int]] = defaultdict(deque)
    for j, stamp in enumerate(second.tolist()):
        places[stamp].append(j)
    pairs = [(i, places[stamp].popleft()) for i, stamp in enumerate(first.tolist()) if places.get(stamp)]
    n_exact = len(pairs)
    pairs += _near_pairs(first, second, pairs, tolerance)
    table = np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)
    return Association(first=table[:, 0], second=table[:, 1], n_exact=n_exact, by="stamp")


def find_stamps(stamps: Floats, wanted: Floats, *, tolerance: float = 1e-4) -> Ints:
    """Return (m,) indices of the wanted stamps: equal, else nearest within a tolerance; -1 for none or several."""
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


Which: TypeAlias = Literal["near", "far", "all"]
"""Which relations: between scans less than some seconds apart, the others, or all."""

NEAR = 5.0  # relations of scans less than this apart are near, seconds


@dataclass(frozen=True, eq=False, kw_only=True)
class RelationErrors:
    """Errors of the relations whose scans are in the trajectory, in the order of the relations."""

    n_given: int  # relations in the file, those included whose scans are not in the trajectory
    is_near: Bools  # (n,): whether the two scans are less than `near` apart
    near: float  # seconds
    translation: Floats  # (n,): metres
    rotation: Floats  # (n,): absolute error in angle, radians
    scan: Ints  # (n,): index of the later scan in the trajectory
    place: Floats  # (n,): length of the trajectory up to it, metres
    between: Floats  # (n,): length of the trajectory between the two scans, metres
    benchmark: "BenchmarkLog | None" = None  # published errors of the same log, where there are any

    def __len__(self) -> int:
        return len(self.translation)

    def __repr__(self) -> str:
        translation, rotation = self.spreads("all")
        return (
            f"RelationErrors({len(self):,} of {self.n_given:,} relations, mean {translation.mean:.4f} m, "
            f"{np.degrees(rotation.mean):.2f} deg)"
        )

    @property
    def n_missing(self) -> int:
        """Number of relations whose scans are not in the trajectory."""
        return self.n_given - len(self)

    def spreads(self, which: Which) -> tuple[Spread, Spread]:
        """Return the figures of the translation (metres) and of the rotation (radians)."""
        chosen = {"near": self.is_near, "far": ~self.is_near, "all": np.full(len(self), True)}[which]
        return Spread.of(self.translation[chosen]), Spread.of(self.rotation[chosen])


def relation_errors(
    trajectory: Trajectory,
    relations: Relations,
    laser_pose: ArrayLike = (0.0, 0.0, 0.0),
    *,
    near: float = NEAR,
    benchmark: "BenchmarkLog | None" = None,
) -> RelationErrors:
    """Return the errors of a sensor's trajectory against relations of its robot. laser_pose (3,)."""
    robot = se2.compose(trajectory.poses, se2.inverse(laser_pose))
    is_known = ~np.isnan(robot[:, 2])
    first = find_stamps(trajectory.stamps, relations.first_stamps)
    second = find_stamps(trajectory.stamps, relations.second_stamps)
    found = np.flatnonzero((first >= 0) & (second >= 0))
    found = found[is_known[first[found]] & is_known[second[found]]]
    if found.size == 0:
        raise InvalidArgumentError(
            f"none of the {len(relations):,} relations joins two stamps of the trajectory, "
            f"{span_of(trajectory.stamps)}; those of the relations are "
            f"{span_of(np.concatenate([relations.first_stamps, relations.second_stamps]))}"
        )
    i, j = first[found], second[found]
    off = se2.between(relations.poses[found], se2.between(robot[i], robot[j]))
    length = travelled(robot)
    return RelationErrors(
        n_given=len(relations),
        is_near=relations.gaps[found] < near,
        near=near,
        translation=np.hypot(off[:, 0], off[:, 1]),
        rotation=np.abs(off[:, 2]),
        scan=np.maximum(i, j),
        place=length[np.maximum(i, j)],
        between=np.abs(length[j] - length[i]),
        benchmark=benchmark,
    )


def span_of(stamps: Floats) -> str:
    """Return the span of stamps in words."""
    return f"from {stamps.min():.6f} to {stamps.max():.6f} s"


SOURCE = "Kümmerle et al., Autonomous Robots 27 (2009) 387-407, but for Cartographer's"


@dataclass(frozen=True, kw_only=True)
class PublishedError:
    """What one method reached on one log, over all of its relations."""

    method: str  # in words
    translation: Sequence[float]  # mean and standard deviation, metres
    rotation: Sequence[float] = ()  # mean and standard deviation, degrees, as far as they were published


@dataclass(frozen=True, kw_only=True)
class BenchmarkLog:
    """A log of the benchmark."""

    name: str  # in words
    keys: tuple[str, ...]  # A file whose name holds one of these belongs to it
    errors: tuple[PublishedError, ...]  # what was published


BENCHMARKS = {
    key: BenchmarkLog(
        name=row["name"], keys=tuple(row["keys"]), errors=tuple(PublishedError(**error) for error in row["errors"])
    )
    for key, row in shipped_table(__package__, "published.toml").items()
}
"""The logs of the benchmark by name."""


def find_benchmark(name: str | None, file_name: str = "") -> BenchmarkLog | None:
    """Return the benchmark of that name, or that the name of a file contains; None without one."""
    if name is not None:
        return look_up(BENCHMARKS, name, "benchmark")
    words = file_name.lower().replace("_", "-")
    return next((b for b in BENCHMARKS.values() if any(key in words for key in b.keys)), None)
