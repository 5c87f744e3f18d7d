"""GrowingMap: keyframes, the pose graph that ties them, and what the graph knows of the newest one.

A keyframe is tied to the one before it by what a match and the odometry say of the way; an optimization revises all
poses, a loop closure those since it; places that hold too many keyframes lose the oldest.
"""

from __future__ import annotations

import math
from itertools import accumulate

import numpy as np

from curvescan import se2
from curvescan.matchers.result import log_odds, slip_odds
from curvescan.odometry.gaps import LOST_COVARIANCE
from curvescan.odometry.measurement import CERTAIN, as_measurement
from curvescan.odometry.step import Step, StepOutcome
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, compose, fuse, identity, inverse
from curvescan.slam.config import GATE, NoiseConfig, SlamConfig
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loops.closures import Closure
from curvescan.slam.loops.cycles import Chain, difference
from curvescan.slam.loops.marginals import Marginals, composed_covariances
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph, as_if_tracked, components, is_lost
from curvescan.slam.pose_graph.posterior import covariances_seen_from
from curvescan.slam.pose_graph.robust import optimized
from curvescan.slam.thinning import Removed, thin, with_gone
from curvescan.types import Bools, Cov, Ints, Pose

_NEARBY = 6.0  # convexity to begin with where the optimum is near that of the last one; else every edge is reconsidered


def solve(graph: PoseGraph, noise: NoiseConfig, is_last: bool) -> tuple[PoseGraph, Cov]:
    """Move a pose graph, a copy, to its robust optimum, and return it; the heavy parts release Python's lock.

    With it, (n, 3, 3) covariances of its keyframes with the last one, which scans hang on, known exactly. A false
    closure bends the steps beside it more than itself: from where no step may err an optimum without it is found.
    """
    optimum = optimized(graph, weights=graph.weights, least_convexity=0.0 if is_last else _NEARBY)
    if is_last:
        soft = graph.edge_covariances.copy()
        graph.edge_covariances[~graph.is_closure] = noise.floor
        held = optimized(graph, weights=None)
        graph.poses[:], graph.edge_covariances[:] = held.poses, soft
        freed = optimized(graph, weights=held.weights, least_convexity=_NEARBY)
        optimum = min(optimum, freed, key=lambda one: one.costs.sum())
    graph.poses[:], graph.weights[:] = optimum.poses, optimum.weights
    graph.edge_covariances[:] = as_if_tracked(graph.edge_covariances)  # for the search: a match there ties the parts
    return graph, covariances_seen_from(graph, graph.n_poses - 1, noise)


class GrowingMap:
    """Keyframes and their graph."""

    def __init__(self, keyframes: Keyframes, config: SlamConfig) -> None:
        self.config = config
        self.keyframes = keyframes
        self.graph = PoseGraph()
        self.gone: list[Removed] = []  # keyframes that went, in their order
        self.since = identity()  # the newest keyframe, seen from the last one of the marginals
        self.fragments: list[int] = []  # of each keyframe
        self.is_revised = False  # whether poses moved since somebody last asked
        self._session = 0
        self._open_way = 0.0  # since a match of keyframes measured all of the motion, metres
        self.marginals: Marginals  # what the graph knew after the last optimization, once there is a keyframe
        self._steps: list[UncertainPose] = []  # of the graph: each keyframe seen from the one before it
        self._chain: Chain | None = None  # see :meth:`chain`; until the poses of the marginals change

    def load(self, slam_map: SlamMap) -> None:
        """Take a map to continue."""
        self.keyframes.add_all(slam_map)
        self._session = slam_map.n_sessions
        self.graph = slam_map.graph()
        self._steps = steps_of(self.graph)
        ties = self.graph.ends[~is_lost(self.graph.edge_covariances)]
        self.fragments = components(ties, self.graph.n_poses).tolist()

    def start(self, scan: LaserScan, index: int) -> int:
        """Begin a drive: take a keyframe that nothing ties to those of the map, and return its row."""
        k = self.keyframes.add(scan, index, self._session)
        self.graph.add_pose(np.zeros(3))
        self._steps.append(UncertainPose(np.zeros(3), LOST_COVARIANCE.copy()))
        self.fragments.append(max(self.fragments, default=-1) + 1)
        unknown = np.concatenate((np.tile(LOST_COVARIANCE, (k, 1, 1)), np.zeros((1, 3, 3))))
        self.marginals = Marginals.of(self.graph.poses, unknown)
        return k

    def append(self, scan: LaserScan, step: Step, motion: UncertainPose) -> int:
        """Take the next keyframe, tie it to the one before it, and return its row.

        The match of both counts in the directions that it measures, the odometry's motion in the others; where the two
        contradict each other the motion counts, and is as uncertain as they differ, so far as it may have slipped.
        Where the track was lost in between and they do not match, the keyframe begins a fragment: the sensor went on,
        as the motion has it, or was carried away, as the covariance of the edge says.
        """
        noise, k = self.config.noise, self.keyframes.add(scan, step.index, self._session)
        before, was_lost = k - 1, step.outcome is StepOutcome.LOST
        result, kind = self.keyframes.match(before, self.keyframes.prepared(k), None), EdgeKind.MOTION
        n_unseen = 0 if result.ok else step.index - self.keyframes[before].index - 1
        way = noise.slipped(motion, self._open_way, n_unseen, step.wheel_slip)
        self._open_way += float(np.hypot(way.pose[0], way.pose[1]))
        if result.ok:
            found = as_measurement(result)
            found = UncertainPose(found.pose, noise.edge(found.covariance))
            fused, distance = fuse(way, found)
            if distance >= GATE:
                off = difference(way.pose, found.pose)
                errs = slip_odds(off[:2], distance) - log_odds(result.confidence, unknown=CERTAIN)
                way = UncertainPose(way.pose, way.covariance + np.outer(off, off) / (1.0 + math.exp(errs)))
            elif result.degenerate_direction is None:
                way, self._open_way, kind = found, 0.0, EdgeKind.MATCH
            else:
                way = fused
        was_lost &= kind is EdgeKind.MOTION
        self.fragments.append(max(self.fragments) + 1 if was_lost else self.fragments[before])
        self.graph.add_pose(se2.compose(self.graph.poses[before], way.pose))
        self.graph.add_edge(before, k, way.pose, way.covariance + was_lost * LOST_COVARIANCE, kind)
        self._steps.append(way)
        self.since = compose(self.since, way)
        return k

    def along(self, first: int) -> list[UncertainPose]:
        """Return the newest keyframe seen from each one, from a first row on, along the keyframes between them."""
        ways = accumulate(self._steps[:first:-1], lambda way, step: compose(step, way), initial=identity())
        poses = se2.between(self.graph.poses[first:], self.graph.poses[-1])
        return [UncertainPose(pose, way.covariance) for pose, way in zip(poses[::-1], ways, strict=False)][::-1]

    def seen_from(self, rows: Ints) -> tuple[Pose, Cov]:
        """Return the newest keyframe seen from others, (m, 3) and (m, 3, 3), as if none was lost; rows (m,) rising."""
        (relative, covariances), n = self.marginals, self.marginals.n
        known, later = np.split(rows, [np.searchsorted(rows, n)])
        by_marginals = composed_covariances(relative[known], covariances[known], self.since)
        along = np.reshape([way.covariance for way in self.along(n)], (-1, 3, 3))[later - n]
        return se2.between(self.graph.poses[rows], self.graph.poses[-1]), np.concatenate((by_marginals, along))

    def chain(self) -> Chain:
        """Return the keyframes; those since the last optimization lie along the odometry, as if no loop had closed."""
        if self._chain is None:
            n = self.marginals.n
            self._chain = Chain.of(self.graph.poses[:n], [step.covariance for step in self._steps[:n]])
        if new := self._steps[len(self._chain.poses) :]:
            self._chain = self._chain.extended(new)
        return self._chain

    def close(self, closure: Closure) -> None:
        """Make a closure an edge, and take the newest keyframe to where it says."""
        i, j = closure.i, closure.j
        if self.fragments[i] != self.fragments[j]:
            self._join(closure)
        self.graph.add_edge(i, j, closure.pose, closure.covariance, EdgeKind.CLOSURE)
        if i >= self.marginals.n or j < self.marginals.n:
            return
        by_closure = compose(inverse(self.marginals.last_seen_from(i)), UncertainPose(closure.pose, closure.covariance))
        self.since, _ = fuse(self.since, compose(by_closure, self.along(j)[0]))
        here = se2.compose(self.graph.poses[self.marginals.n - 1], self.since.pose)
        onward = se2.between(self.graph.poses[-1], self.graph.poses[j:])
        self.graph.poses[j:], self.is_revised = se2.compose(here, onward), True

    def _join(self, closure: Closure) -> None:
        """Move the later fragment to the place in the earlier one that a closure gives."""
        fragments, poses = np.array(self.fragments), self.graph.poses
        earlier, later = sorted((fragments[closure.i], fragments[closure.j]))
        (i, j), seen = (closure.i, closure.j), closure.pose
        if fragments[j] == earlier:
            i, j, seen = j, i, se2.inverse(seen)
        shift = se2.compose(se2.compose(poses[i], seen), se2.inverse(poses[j]))
        rows = np.flatnonzero(fragments == later)
        poses[rows], self._chain, self.is_revised = se2.compose(shift, poses[rows]), None, True
        self.fragments = np.where(fragments == later, earlier, fragments).tolist()

    def adopt(self, solved: PoseGraph, covariances: Cov) -> None:
        """Take the poses of an optimization; keyframes that came since move along with the one they hang on."""
        n = solved.n_poses
        later = se2.between(self.graph.poses[n - 1], self.graph.poses[n:])
        self.since = self.along(n - 1)[0]
        self.graph.poses[:n] = solved.poses
        self.graph.poses[n:] = se2.compose(solved.poses[-1], later)
        self.graph.weights[: len(solved.weights)] = solved.weights
        self.marginals, self._chain, self.is_revised = Marginals.of(solved.poses, covariances), None, True

    def thin(self) -> Bools:
        """Let the oldest keyframes of places that hold too many go, and return which rows stayed."""
        is_kept, gone = thin(self.graph, np.asarray(self.fragments), self.marginals.n - 1, self.config.places)
        numbers = self.keyframes.numbers.tolist()
        for v, ties in gone.items():
            self.gone.append(Removed(numbers[v], *(one._replace(to=numbers[one.to]) for one in ties)))
        if gone:
            self.graph.keep_poses(is_kept)
            self.keyframes.keep(is_kept)
            self._steps = steps_of(self.graph)
            self.fragments = np.array(self.fragments)[is_kept].tolist()
            self.marginals, self._chain = Marginals(*(known[is_kept[: len(known)]] for known in self.marginals)), None
        return is_kept

    def current_in_map(self) -> UncertainPose:
        """Return where the newest keyframe is in the map."""
        from_first = compose(self.marginals.last_seen_from(0), self.since)
        in_map = compose(UncertainPose(self.graph.poses[0], np.zeros((3, 3))), from_first)
        is_apart = self.fragments[-1] != self.fragments[0]
        return UncertainPose(self.graph.poses[-1], in_map.covariance + is_apart * LOST_COVARIANCE)

    def covariances(self) -> Cov:
        """Return (n, 3, 3) covariance of each keyframe in the map, the first one known exactly."""
        if self.graph.n_poses == 0:
            return np.empty((0, 3, 3))
        return covariances_seen_from(self.graph, 0, self.config.noise)

    def placed(self) -> tuple[Pose, Cov]:
        """Return poses and covariances of all keyframes there ever were, by number."""
        poses, spread = self.graph.poses, self.config.noise.spread
        return with_gone(self.gone, self.keyframes.numbers, poses, self.covariances(), spread)

    def snapshot(self) -> SlamMap:
        """Return the map as it is now."""
        return SlamMap(
            scans=tuple(keyframe.scan for keyframe in self.keyframes),
            covariances=self.covariances(),
            indices=np.array([keyframe.index for keyframe in self.keyframes], dtype=np.int64),
            sessions=np.array([keyframe.session for keyframe in self.keyframes], dtype=np.int64),
            **self.graph.arrays(),
        )


def steps_of(graph: PoseGraph) -> list[UncertainPose]:
    """Return how each pose is seen from the one before it, by the steps of a graph."""
    steps, covariances = np.zeros((graph.n_poses, 3)), np.tile(LOST_COVARIANCE, (graph.n_poses, 1, 1))
    rows = np.flatnonzero(~graph.is_closure & (np.diff(graph.ends)[:, 0] == 1))
    at = graph.ends[rows, 1]
    steps[at], covariances[at] = graph.measured[rows], as_if_tracked(graph.edge_covariances[rows])
    return list(map(UncertainPose, steps, covariances))
