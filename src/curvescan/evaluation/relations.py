"""Errors of a trajectory against relations: the measure of the Freiburg SLAM benchmark.

R. Kümmerle et al., "On measuring the accuracy of SLAM algorithms", Autonomous Robots 27 (2009): the error of relation
(i, j) is the motion from the true relative pose to the estimated one; its translation and its rotation are reported
separately. Near relations, between scans a few seconds apart, measure the matching; far ones, between visits of one
place, measure what has added up in between, which a trajectory without loop closing cannot avoid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.configs import shipped_table
from curvescan.errors import InvalidArgumentError
from curvescan.evaluation.association import find_stamps
from curvescan.evaluation.trajectory_errors import Spread, travelled
from curvescan.io.trajectories.relations import Relations, read_relations
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.types import Bools, Floats, Ints

__all__ = ["RelationErrors", "Relations", "Which", "read_relations", "relation_errors"]


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
    benchmark: BenchmarkLog | None = None  # published errors of the same log, where there are any

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
    benchmark: BenchmarkLog | None = None,
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
    translation: tuple[float, float]  # mean and standard deviation, metres
    # mean and standard deviation, degrees, as far as they were published
    rotation: tuple[float, float | None] | None = None


@dataclass(frozen=True, kw_only=True)
class BenchmarkLog:
    """A log of the benchmark."""

    name: str  # in words
    keys: tuple[str, ...]  # A file whose name holds one of these belongs to it
    errors: tuple[PublishedError, ...]  # what was published


def _error(method: str, translation: list[float], rotation: list[float] | None = None) -> PublishedError:
    mean, std = translation
    degrees = None if rotation is None else (rotation[0], rotation[1] if len(rotation) > 1 else None)
    return PublishedError(method=method, translation=(mean, std), rotation=degrees)


def _read() -> dict[str, BenchmarkLog]:
    return {
        key: BenchmarkLog(name=row["name"], keys=tuple(row["keys"]), errors=tuple(_error(**e) for e in row["errors"]))
        for key, row in shipped_table(__package__, "published.toml").items()
    }


BENCHMARKS: dict[str, BenchmarkLog] = _read()
"""The logs of the benchmark by name."""


def find_benchmark(name: str | None, file_name: str = "") -> BenchmarkLog | None:
    """Return the benchmark of that name, or that the name of a file contains; None without one."""
    if name is not None:
        if name not in BENCHMARKS:
            raise InvalidArgumentError(f"there is no benchmark {name!r}; known are {', '.join(BENCHMARKS)}")
        return BENCHMARKS[name]
    words = file_name.lower().replace("_", "-")
    return next((b for b in BENCHMARKS.values() if any(key in words for key in b.keys)), None)
