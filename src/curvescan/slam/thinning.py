"""Thinning: each place keeps few keyframes, the newest: memory follows the area and not the time.

A keyframe that goes leaves its heir, one of the same place, and how it lay to it: scans that hang on it still move with
the map.
"""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.se2.uncertain import UncertainPose, compose, wrap_angle
from curvescan.slam.config import PlacesConfig
from curvescan.slam.pose_graph.graph import PoseGraph
from curvescan.slam.pose_graph.removal import carry_over, heir_of
from curvescan.types import Bools, Cov, Ints, Pose

_ROUNDING = 1e-9  # metres and radians: what is counted in a kernel is looked at again


class Heirs:
    """Keyframes that went, in their order: number, number of the heir, and the pose seen from it."""

    def __init__(self) -> None:
        self._of: list[tuple[int, int, UncertainPose]] = []

    def __len__(self) -> int:
        return len(self._of)

    def add(self, number: int, heir: int, seen: UncertainPose) -> None:
        """Take the keyframe `number`, seen from its heir."""
        self._of.append((number, heir, seen))

    def placed(self, numbers: Ints, poses: Pose, covariances: Cov) -> tuple[Pose, Cov]:
        """Return (m, 3) poses and (m, 3, 3) covariances of all keyframes there ever were, by number.

        numbers (n,); poses, covariances (n, 3).
        """
        if not self._of:
            return poses, covariances
        n_all = len(numbers) + len(self._of)
        all_poses, all_covariances = np.empty((n_all, 3)), np.empty((n_all, 3, 3))
        all_poses[numbers], all_covariances[numbers] = poses, covariances
        for number, heir, seen in reversed(self._of):
            found = compose(UncertainPose(all_poses[heir], all_covariances[heir]), seen)
            all_poses[number], all_covariances[number] = found.pose, found.cov
        return all_poses, all_covariances


def thin(
    graph: PoseGraph, fragments: Ints, n_settled: int, rules: PlacesConfig
) -> tuple[Bools, dict[int, tuple[int, UncertainPose]]]:
    """Take keyframes out where a place has too many; return which stay, and what became of the others.

    fragments (n,); result (n,).
    """
    poses = graph.poses
    is_kept = np.ones(len(poses), dtype=np.bool_)
    gone: dict[int, tuple[int, UncertainPose]] = {}
    crowded = crowded_places(
        poses, fragments, max(n_settled, 0), rules.radius + _ROUNDING, rules.turn + _ROUNDING, rules.n_keyframes
    )
    for v in np.flatnonzero(crowded).tolist():
        off = poses[v + 1 :] - poses[v]
        near = np.hypot(off[:, 0], off[:, 1]) < rules.radius
        near &= np.abs(se2.wrap(off[:, 2])) < rules.turn
        near &= is_kept[v + 1 :] & (fragments[v + 1 :] == fragments[v])
        newer = v + 1 + np.flatnonzero(near)
        if len(newer) < rules.n_keyframes:
            continue
        heir = heir_of(graph, v, newer)
        if heir is None:
            continue
        gone[v] = heir, carry_over(graph, v, heir)
        is_kept[v] = False
    return is_kept, gone


@kernel
def crowded_places(poses: Pose, fragments: Ints, n_settled: int, radius: float, turn: float, n_least: int) -> Bools:
    """Return (n_settled,) which poses have `n_least` later ones of their fragment near; never the first."""
    crowded = np.zeros(n_settled, dtype=np.bool_)
    for v in range(1, n_settled):
        n_near = 0
        for u in range(v + 1, poses.shape[0]):
            dx, dy = poses[u, 0] - poses[v, 0], poses[u, 1] - poses[v, 1]
            if dx * dx + dy * dy >= radius * radius or fragments[u] != fragments[v]:
                continue
            n_near += abs(wrap_angle(poses[u, 2] - poses[v, 2])) < turn
            if n_near == n_least:
                crowded[v] = True
                break
    return crowded
