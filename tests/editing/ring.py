"""A map of a ring of keyframes whose true poses are known, with a closure across the start."""

import numpy as np

from curvescan import LaserScan, SlamMap, se2
from curvescan.slam.pose_graph.graph import EdgeKind

N = 60


def ring(seed=0, n_closures=6):
    """Return the map of an odometry round a square with 1 cm and 0.2 degrees of noise a step, and its true poses."""
    rng = np.random.default_rng(seed)
    turns = np.where(np.arange(N) % (N // 4) == N // 4 - 1, np.pi / 2, 0.0)
    truth = [np.zeros(3)]
    for turn in turns[:-1]:
        truth.append(se2.compose(truth[-1], np.array([0.5, 0.0, turn])))
    truth = np.array(truth)
    sigma = np.array([0.01, 0.01, 0.0035])
    pairs = [(k, k + 1) for k in range(N - 1)] + [(k, N - 1 - k) for k in range(n_closures)]
    measured = np.array([se2.between(truth[i], truth[j]) + sigma * rng.standard_normal(3) for i, j in pairs])
    poses = [np.zeros(3)]
    for step in measured[: N - 1]:
        poses.append(se2.compose(poses[-1], step))
    kinds = np.full(len(pairs), int(EdgeKind.MATCH))
    kinds[N - 1 :] = EdgeKind.CLOSURE
    scans = tuple(LaserScan(np.full(36, 4.0), angle_min=-np.pi, angle_increment=np.pi / 18, stamp=k) for k in range(N))
    slam_map = SlamMap(
        scans=scans, poses=np.array(poses), covariances=np.tile(np.eye(3), (N, 1, 1)), indices=np.arange(N),
        sessions=np.zeros(N, dtype=np.int64), ends=np.array(pairs), measured=measured,
        edge_covariances=np.tile(np.diag(sigma**2), (len(pairs), 1, 1)), kinds=kinds, weights=np.ones(len(pairs)),
    )  # fmt: skip
    return slam_map, truth


def false_closure(i=5, j=33):
    """Return an edit that says that two keyframes far apart are at one place."""
    from curvescan.editing.edits import Edit

    return Edit(do="add", i=i, j=j, pose=(0.0, 0.0, 0.0), covariance=tuple((1e-4 * np.eye(3)).ravel().tolist()))
