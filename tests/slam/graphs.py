"""Pose graphs with known truth."""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.odometry.step import Step, StepOutcome
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph
from curvescan.slam.pose_graph.optimization import Edges, linearized
from curvescan.types import Pose

SIGMAS = np.array([0.02, 0.03, 0.01])


def loop(n: int, n_laps: int = 2) -> Pose:
    """Return (n, 3) poses on a circle that is gone round several times."""
    angle = np.linspace(0.0, 2.0 * np.pi * n_laps, n, endpoint=False)
    poses = np.column_stack((5.0 * np.sin(angle), 5.0 - 5.0 * np.cos(angle), angle))
    poses[:, 2] = se2.wrap(poses[:, 2])
    return poses


def measured_edges(truth: Pose, ends: list[tuple[int, int]], seed: int) -> Edges:
    """Return edges with Gaussian noise of SIGMAS."""
    rng = np.random.default_rng(seed)
    rows = np.array(ends, dtype=np.int64)
    measured = se2.between(truth[rows[:, 0]], truth[rows[:, 1]])
    measured += SIGMAS * rng.standard_normal(measured.shape)
    covariances = np.tile(np.diag(SIGMAS**2), (len(rows), 1, 1))
    return Edges.of(rows, measured, covariances)


def graph_of(poses: Pose, edges: Edges, steps: EdgeKind = EdgeKind.MATCH) -> PoseGraph:
    """Return a graph of n poses; the first n - 1 edges are the chain, the others closures."""
    graph = PoseGraph()
    for pose in poses:
        graph.add_pose(pose)
    for k, (i, j) in enumerate(edges.ends.tolist()):
        kind = steps if k < len(poses) - 1 else EdgeKind.CLOSURE
        graph.add_edge(i, j, edges.measured[k], np.diag(SIGMAS**2), kind)
    return graph


def ladder(n: int) -> list[tuple[int, int]]:
    """Return the chain of n poses, and closures between two laps of n / 2."""
    chain = [(k, k + 1) for k in range(n - 1)]
    return chain + [(k, k + n // 2) for k in range(0, n // 2, 3)]


def dead_reckoning(edges: Edges, n: int) -> Pose:
    """Return the poses that the chain gives, the first n - 1 edges."""
    poses = np.zeros((n, 3))
    for k in range(n - 1):
        poses[k + 1] = se2.compose(poses[k], edges.measured[k])
    return poses


def dense_information(poses: np.ndarray, edges: Edges, weights: np.ndarray, anchors: np.ndarray) -> np.ndarray:
    """J^T W J of all edges, (3n, 3n); poses that are anchored stand for themselves."""
    n, jacobians = len(poses), linearized(poses, *edges, weights)[0]
    found = np.zeros((3 * n, 3 * n))
    for k, ends in enumerate(edges.ends):
        jac = np.zeros((3, 3 * n))
        for pose, block in zip(ends, jacobians[k], strict=True):
            jac[:, 3 * pose : 3 * pose + 3] = block
        found += weights[k] * jac.T @ edges.information[k] @ jac
    held = (3 * anchors[:, np.newaxis] + np.arange(3)).ravel()
    found[held], found[:, held] = 0.0, 0.0
    found[held, held] = 1.0
    return found


def step_of(index: int, outcome: StepOutcome = StepOutcome.MATCHED) -> Step:
    """Return a step of an odometry without wheels; where it led is not in it."""
    return Step(
        index=index, stamp=np.nan, pose=np.zeros(3), covariance=np.eye(3), pose_odom=np.zeros(3),
        covariance_odom=np.eye(3), motion=np.zeros(3), motion_covariance=np.eye(3), seconds=0.0, outcome=outcome,
        match=None, reference=None,
    )  # fmt: skip
