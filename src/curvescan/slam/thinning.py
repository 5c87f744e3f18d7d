"""Thinning: each place keeps few keyframes, the newest: memory follows the area and not the time.

A keyframe that goes leaves its representative, one of the same place, and how it lay to it and to the one before: scans
that hang on it still move with the map. What its edges measured is carried over to those that stay. The exact marginal
ties all neighbours to each other. Kept of it are the steps of the chain, composed, and the closures, moved to the
representative. After Eade, Fong and Munich, "Monocular graph SLAM with complexity reduction", IROS 2010.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.se2.uncertain import UncertainPose, compose, fuse, inverse
from curvescan.slam.config import GATE, PlacesConfig
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph, is_lost, is_whole
from curvescan.types import Bools, Cov, Ints, Pose


class Tie(NamedTuple):
    """Another keyframe, and how one lies to it."""

    to: int
    seen: UncertainPose


class Removed(NamedTuple):
    """What became of a keyframe that went, by numbers that stay."""

    number: int
    tie: Tie  # to its representative, by a match
    step: Tie  # to the one before it; to the representative where there was none


def with_gone(gone: list[Removed], numbers: Ints, poses: Pose, covariances: Cov, spread: Cov) -> tuple[Pose, Cov]:
    """Return (m, 3) poses and (m, 3, 3) covariances of all keyframes there ever were, by number.

    gone: in the order in which they went; numbers (n,), poses (n, 3), covariances (n, 3, 3): of those that stayed;
    spread (3, 3): covariance that the difference of two estimates of one pose has besides theirs.
    """
    n_all = len(numbers) + len(gone)
    all_poses, all_covariances = np.empty((n_all, 3)), np.empty((n_all, 3, 3))
    all_poses[numbers], all_covariances[numbers] = poses, covariances
    for number, tie, step in reversed(gone):
        by_tie = se2.between(all_poses[step.to], se2.compose(all_poses[tie.to], tie.seen.pose))
        # a match that the finished map contradicts was false: the way beside it holds
        to, seen = tie if fuse(step.seen, UncertainPose(by_tie, tie.seen.covariance + spread))[1] < GATE else step
        found = compose(UncertainPose(all_poses[to], all_covariances[to]), seen)
        all_poses[number], all_covariances[number] = found.pose, found.covariance
    return all_poses, all_covariances


def thin(
    graph: PoseGraph, fragments: Ints, n_settled: int, rules: PlacesConfig
) -> tuple[Bools, dict[int, tuple[Tie, Tie]]]:
    """Take keyframes out where a place has too many; return (n,) which stay, and the ties by row of each other one."""
    is_kept = np.ones(graph.n_poses, dtype=np.bool_)
    gone: dict[int, tuple[Tie, Tie]] = {}
    older, newer = pairs_alike(graph.poses, fragments, rules.radius).T
    first = np.searchsorted(older, np.arange(n_settled + 1))
    for v in (1 + np.flatnonzero(np.diff(first[1:]) >= rules.n_keyframes)).tolist():  # the first is the map's frame
        beside = newer[first[v] : first[v + 1]]
        beside = beside[is_kept[beside]]
        tie = best_tie(graph, v, beside) if len(beside) >= rules.n_keyframes else None
        if tie is not None:
            gone[v] = carry_over(graph, v, tie)
            is_kept[v] = False
    return is_kept, gone


def pairs_alike(poses: Pose, fragments: Ints, radius: float) -> Ints:
    """Return (k, 2) pairs of poses of a fragment that lie so near, in radians too, the earlier first and rising."""
    from scipy.spatial import cKDTree  # loads for a good part of a second

    pairs = cKDTree(poses[:, :2]).query_pairs(radius, output_type="ndarray")
    i, j = pairs[np.argsort(pairs[:, 0], kind="stable")].T
    is_alike = (fragments[i] == fragments[j]) & (np.abs(se2.wrap(poses[j, 2] - poses[i, 2])) < radius)
    return np.column_stack((i[is_alike], j[is_alike]))


def best_tie(graph: PoseGraph, v: int, among: Ints) -> int | None:
    """Return the closure or match that ties pose v best to one of some poses; None where there is none."""
    rows = _edges_at(graph, v)
    covariances = graph.edge_covariances[rows]
    # by an edge that leaves a direction open no pose can hang on a representative; what a lost track hangs on stays
    is_tie = (graph.kinds[rows] != EdgeKind.MOTION) & graph.is_followed[rows] & is_whole(covariances)
    is_tie &= np.isin(graph.ends[rows], among).any(axis=1)
    spread = np.where(is_tie, np.trace(covariances, axis1=1, axis2=2), np.inf)
    return int(rows[np.argmin(spread)]) if is_tie.any() and not is_lost(covariances).any() else None


def carry_over(graph: PoseGraph, v: int, tie: int) -> tuple[Tie, Tie]:
    """Carry the edges of pose v over to those that stay, take them out; return its ties, by edge `tie` and by step."""
    rows = _edges_at(graph, v)
    seen = {row: _other_end(graph, row, v) for row in rows.tolist()}
    other, other_seen = seen[tie]
    from_other = inverse(other_seen)
    steps = [row for row in seen if not graph.is_closure[row]]
    before, after = ([row for row in steps if (seen[row][0] < v) is is_before] for is_before in (True, False))
    if before and after:
        (i, a), (j, b) = seen[before[-1]], seen[after[0]]
        ends = [before[-1], after[0]]
        step, kind = compose(inverse(a), b), EdgeKind(max(graph.kinds[ends]))
        graph.add_edge(i, j, step.pose, step.covariance, kind, float(min(graph.weights[ends])))
    tied = set(graph.ends[_edges_at(graph, other)].ravel().tolist())  # and the representative itself
    for row, (u, edge) in seen.items():
        if graph.is_closure[row] and graph.is_followed[row] and u not in tied:
            tied.add(u)
            moved = compose(from_other, edge)
            moved = inverse(moved) if other > u else moved
            graph.add_edge(min(other, u), max(other, u), moved.pose, moved.covariance, graph.kinds[row])
    graph.keep_edges(~np.isin(np.arange(len(graph.ends)), rows))
    i, edge = seen[before[-1] if before else tie]
    return Tie(other, from_other), Tie(i, inverse(edge))


def _edges_at(graph: PoseGraph, v: int) -> Ints:
    return np.flatnonzero((graph.ends == v).any(axis=1))


def _other_end(graph: PoseGraph, row: int, v: int) -> tuple[int, UncertainPose]:
    """Return the other end of an edge, and how pose v sees it."""
    i, j = graph.ends[row].tolist()
    edge = UncertainPose(graph.measured[row].copy(), graph.edge_covariances[row].copy())
    return (j, edge) if i == v else (i, inverse(edge))
