"""Covariances of the poses in the optimum, by the residuals, with noise that edges share.

The marginals of the information matrix are too small where a keyframe has many edges: the noise of its scan is in all
of them. The errors of its K matches have a correlation r, so the variance of their mean is (1 + (K - 1) r) / K of that
of one (the design effect of surveys, Kish 1965), and the covariance of each is to be multiplied by 1 + (K - 1) r. And
the edges' covariances may be too large or too small as a whole: their residuals in the optimum tell (the variance of
unit weight, as in geodesy). The floor that an edge has so that matches which claim too much do not rule the optimum is
no part of it: of clean scans it is several times their error. Last, the noise of a keyframe's own scan moves it against
all others alike, and shows in no residual.
"""

from __future__ import annotations

import numpy as np

from curvescan.odometry.gaps import LOST_COVARIANCE
from curvescan.slam.config import GATE, KEPT, NoiseConfig
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph, components, is_whole
from curvescan.slam.pose_graph.optimization import Edges, marginal_covariances, squared_distances
from curvescan.types import Bools, Cov, Floats, Ints, Pose

_PRIOR = 30.0
"""Degrees of freedom that the covariances as they are count for: of few residuals nothing is concluded."""

_DRIFT = 0.001
"""Standard deviation by which matches in a row turn the heading over a way of a metre or a radian, radians."""

_NEIGHBOURS = 4
"""Rows between keyframes that follow each other, at most."""

_LEAST_VARIANCE = 1e-8
"""Of a match without its floor: 0.1 mm and 0.1 mrad, squared."""


def covariances_seen_from(graph: PoseGraph, k: int, noise: NoiseConfig, *, in_row: float = 0.0) -> Cov:
    """Return (n, 3, 3) covariance of each pose with pose k known exactly; of other components LOST_COVARIANCE.

    in_row: Share of the variance of steps that no match measures which a whole row of them has in common.
    """
    poses, ends, measured = graph.poses, graph.ends, graph.measured
    off = squared_distances(poses, Edges.of(ends, measured, graph.edge_covariances))
    # a step that slipped is as wide as it is off
    weights = np.where(graph.is_closure, graph.weights, np.minimum(1.0, GATE / np.maximum(off, GATE)))
    is_match = (graph.kinds != EdgeKind.MOTION) & (weights > 0.5)
    covariances = graph.edge_covariances.copy()
    covariances[is_match] = without_floor(covariances[is_match], noise.floor)
    labels = components(ends[weights > 0.0], len(poses))
    off = squared_distances(poses, Edges.of(ends, measured, covariances))
    factor = variance_factor(off[is_match], len(poses) - int(labels.max()) - 1)
    by = np.where(is_match, factor, 1.0) * design_effect(ends, is_match, len(poses), 1.0 - KEPT)
    scaled = covariances * by[:, np.newaxis, np.newaxis]
    if in_row > 0.0:
        steps = np.flatnonzero(graph.kinds == EdgeKind.MOTION)
        steps = steps[np.argsort(ends[steps, 1])]
        row = np.cumsum(np.diff(ends[steps, 1], prepend=-1) != 1)
        scaled[steps, :2, :2] *= 1.0 + in_row * (np.bincount(row)[row] - 1)[:, np.newaxis, np.newaxis]
    scaled[:, 2, 2] += heading_drift(ends, measured, len(poses))
    anchors = np.unique(labels, return_index=True)[1]  # the first pose of each component
    anchors[labels[k]] = k
    found = marginal_covariances(poses, Edges.of(ends, measured, scaled), weights, anchors)
    found[labels != labels[k]] = LOST_COVARIANCE
    # what each of both scans adds to all of its edges; of what a match leaves open it says nothing
    common = (1.0 - KEPT) / (2.0 * KEPT) * covariances
    return with_own_noise(found, poses, own_noise(poses, ends, common, is_match & is_whole(covariances)), k)


def without_floor(covariances: Cov, floor: Cov) -> Cov:
    """Return (m, 3, 3) covariances of edges without a (3, 3) floor that was added to them."""
    values, vectors = np.linalg.eigh(covariances - floor)
    values = np.maximum(values, _LEAST_VARIANCE)
    return np.asarray((vectors * values[:, np.newaxis]) @ vectors.transpose(0, 2, 1).copy())


def design_effect(ends: Ints, is_match: Bools, n_poses: int, correlation: float) -> Floats:
    """Return the (m,) factors of covariances of edges, (m, 2), as other matches of their scans err alike."""
    degrees = np.bincount(ends[is_match].ravel(), minlength=n_poses)
    # half of the matches of a keyframe are with earlier ones; the mean of both ends
    n_alike = (degrees[ends[:, 0]] + degrees[ends[:, 1]]) / 4
    return np.where(is_match, 1.0 + (np.maximum(n_alike, 1.0) - 1.0) * correlation, 1.0)


def heading_drift(ends: Ints, measured: Pose, n_poses: int) -> Floats:
    """Return (m,) variance by which the heading drifts along each edge of neighbours, square radians.

    Matches in a row err alike, which no residual between neighbours shows: edges side by side do not average it.
    """
    low, high = ends.min(axis=1), ends.max(axis=1)
    span = high - low
    is_near = span <= _NEIGHBOURS
    starts = np.bincount(low[is_near], minlength=n_poses) - np.bincount(high[is_near], minlength=n_poses)
    passed = np.concatenate(([0], np.cumsum(np.cumsum(starts))))  # edges over the gaps before each pose, added up
    n_beside = (passed[high] - passed[low]) / np.maximum(span, 1)
    way = np.hypot(measured[:, 0], measured[:, 1]) + np.abs(measured[:, 2])
    return np.where(is_near, _DRIFT**2 * way * n_beside, 0.0)


def variance_factor(distances: Floats, n_poses: int) -> float:
    """Return the factor of the matches' covariances by their (m,) squared Mahalanobis distances in the optimum."""
    redundancy = max(3 * (len(distances) - n_poses), 0)
    if redundancy == 0:
        return 1.0
    return (float(distances.sum()) + _PRIOR) / (redundancy + _PRIOR)


def own_noise(poses: Pose, ends: Ints, covariances: Cov, is_match: Bools) -> Cov:
    """Return (n, 3, 3) covariance of the best of m matches of each keyframe, axes of the map; zeros without any."""
    rows = np.flatnonzero(is_match)
    spread = np.trace(covariances[rows], axis1=1, axis2=2)
    rows = rows[np.argsort(-spread, kind="stable")]
    best = np.full(len(poses), -1)
    best[ends[rows].ravel()] = np.repeat(rows, 2)  # of several the last one stays
    found = np.zeros((len(poses), 3, 3))
    has = np.flatnonzero(best >= 0)
    found[has] = carried(covariances[best[has]], affines(poses[ends[best[has], 0], 2]))
    return found


def with_own_noise(covariances: Cov, poses: Pose, own: Cov, k: int) -> Cov:
    """Return (n, 3, 3) covariances with the noise of the keyframes' own scans; keyframe k stays known exactly."""
    lever = affines(np.zeros(len(poses)), poses[k, 1] - poses[:, 1], poses[:, 0] - poses[k, 0])
    found: Cov = covariances + own + carried(own[k], lever)
    found[k] = covariances[k]
    return found


def affines(angles: Floats, x: Floats | float = 0.0, y: Floats | float = 0.0) -> Cov:
    """Return (n, 3, 3) matrices that turn by angles, and a third column (x, y, 1)."""
    found, c, s = np.zeros((len(angles), 3, 3)), np.cos(angles), np.sin(angles)
    found[:, 0, 0], found[:, 0, 1], found[:, 0, 2] = c, -s, x
    found[:, 1, 0], found[:, 1, 1], found[:, 1, 2] = s, c, y
    found[:, 2, 2] = 1.0
    return found


def carried(covariances: Cov, by: Cov) -> Cov:
    """Return (n, 3, 3) covariances of what (n, 3, 3) matrices make of errors of some, (3, 3) or (n, 3, 3)."""
    return np.asarray(by @ covariances @ by.transpose(0, 2, 1).copy())
