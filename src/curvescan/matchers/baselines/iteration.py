"""The loop all iterated methods share, their outlier gates, and the least squares of those that match points to lines.

The least squares is linearised. It serves Cox (1991) and PL-ICP (Censi 2008): a point p of cur lies at x = R p + t in
ref, its line passes through q with unit normal n, and the error is n . (x - q). A small change (dx, dy, dtheta) of the
pose changes it by J = [n_x, n_y, n . (R p)'] with v' = (-v_y, v_x).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.matchers.baselines.config import ConvergenceConfig
from curvescan.matchers.cfsma.covariance import LEAST_SIGMA
from curvescan.types import Bools, Cov, Floats, Ints, Points, Pose

LEAST_PAIRS = 5  # pairs under which no step is taken; a pose has three unknowns


@dataclass(frozen=True, eq=False, kw_only=True)
class IterationTrace:
    """The way of an iterated method from its guess to where it stopped."""

    poses: Pose  # (k + 1, 3): pose of cur in ref before the first iteration and after each
    has_converged: bool  # whether the last iteration stayed within the limits of where it, or an earlier one, had been
    is_lost: bool  # whether a step found too little to stand on

    @property
    def pose(self) -> Pose:
        """Where it stopped."""
        return np.asarray(self.poses[-1])

    @property
    def n_iterations(self) -> int:
        """Number of steps taken."""
        return len(self.poses) - 1


def iterate(
    guess: Pose, step: Callable[[Pose, int], Pose | None], config: ConvergenceConfig, n_shrinking: int = 0
) -> IterationTrace:
    """Return the poses of a method that repeats one step from a guess (3,) until it no longer moves.

    A few pairs that change sides for ever make it jump between two or three poses: it has converged, too, when a pose
    lies within the limits of any earlier one.
    """
    poses = [guess.tolist()]
    has_converged = is_lost = False
    for iteration in range(max(config.max_iterations, n_shrinking + 1)):
        found = step(np.array(poses[-1]), iteration)
        is_lost = found is None
        if found is None:
            break
        pose = found.tolist()
        has_converged = any(_is_near(pose, one, config) for one in poses[n_shrinking:] if iteration >= n_shrinking)
        poses.append(pose)
        if has_converged:
            break
    return IterationTrace(poses=np.array(poses), has_converged=has_converged, is_lost=is_lost)


def keep_best(squared: Floats, share: float) -> Bools:
    """Return which pairs, (n,) squared distances, inf without partner, are the best share of those that have one."""
    paired = np.isfinite(squared)
    n = int(np.count_nonzero(paired))
    n_kept = math.ceil(share * n)
    if n_kept >= n:
        return paired
    limit = np.partition(squared, n_kept - 1)[n_kept - 1]
    return np.asarray(squared <= limit)


def within_quantile(squared: Floats, kept: Bools, order: float, factor: float) -> Bools:
    """Return which kept pairs lie within `factor` times their own quantile: the adaptive gate of Censi's PL-ICP."""
    distances = squared[kept]
    if distances.size == 0:
        return kept
    at = math.ceil(order * distances.size) - 1
    limit = factor * factor * np.partition(distances, at)[at]
    return np.asarray(kept & (squared <= limit))


def _is_near(pose: list[float], other: list[float], config: ConvergenceConfig) -> bool:
    turned = abs((pose[2] - other[2] + math.pi) % (2.0 * math.pi) - math.pi)
    moved = math.hypot(pose[0] - other[0], pose[1] - other[1])
    return moved < config.min_translation and turned < config.min_rotation


LEAST_SHARE = 0.01
"""Share of the matched readings that must look along every direction of motion. Below it what holds the pose is noise:
tangents err by 2 to 3 degrees, and sin^2(3 deg) = 0.003 of a single wall's readings seem to look along it. In the
corridors of a real log (180 beams) matches under it erred by 10 to 40 mm along them where the robot had moved 55 mm,
those above 5 % by 6 mm."""

DAMPING = 1e-3  # share of a reading added to the information along every direction of a step


def jacobian(points_cur: Points, normals: Points, pose: Pose) -> Floats:
    """Return (n, 3) change of each normal distance with x, y, theta of the pose: 1, 1, metres a radian."""
    turned = points_cur @ se2.rotation(pose[2]).T
    return np.column_stack([normals, normals[:, 1] * turned[:, 0] - normals[:, 0] * turned[:, 1]])


def is_constrained(rows: Floats, points_cur: Points) -> bool:
    """Return whether normal distances fix all three of x, y and theta. rows (n, 3); points_cur (n, 2)."""
    if len(rows) < 3:
        return False
    information = rows.T @ rows / len(rows)
    across, coupling = information[:2, :2], information[:2, 2]
    if np.linalg.eigvalsh(across)[0] < LEAST_SHARE:
        return False
    # what rotation changes that no translation can make good: where the origin lies does not matter
    left = float(information[2, 2] - coupling @ np.linalg.solve(across, coupling))
    return left > max(LEAST_SHARE * float(points_cur.var(axis=0).sum()), LEAST_SIGMA**2)


def point_to_line_step(
    points_cur: Points, anchors: Points, normals: Points, pose: Pose, repeats: int = 2
) -> Pose | None:
    """Return the (3,) pose that minimises squared normal distances to (n, 2) fixed lines, by Gauss-Newton."""
    x, y, theta = _gauss_newton(points_cur, anchors, normals, pose, repeats)
    if not math.isfinite(x + y + theta):
        return None
    return np.array([x, y, math.pi - (math.pi - theta) % (2.0 * math.pi)])


def propagated_covariance(
    rows: Floats, errors: Floats, sources: Sequence[tuple[Ints, Floats]], least_sigma: float = LEAST_SIGMA
) -> Cov:
    """Return the covariance of a least squares pose from the noise behind each error. rows (n, 3); errors (n,).

    Censi, "An accurate closed-form estimate of ICP's covariance", ICRA 2007: to first order the pose moves by H^-1 S^T
    with the readings' noise, H = J^T J, and row s of S the sum of J over the errors that reading s takes part in. Sigma
    is what the errors show, with n - 3 degrees of freedom, or the data sheet's where that is more: a method that trims,
    and picks the nearest reading, shows too little.
    """
    n = len(rows)
    spread = sum(float(weights @ weights) for _, weights in sources) / n
    variance = max(float(errors @ errors) / max(n - 3, 1) / spread, least_sigma**2)
    middle = np.zeros((3, 3))
    for source_idx, weights in sources:
        scores = np.stack([np.bincount(source_idx, rows[:, k] * weights) for k in range(3)], axis=1)
        middle += scores.T @ scores
    inverse = np.linalg.inv(rows.T @ rows)
    covariance: Cov = inverse @ middle @ inverse * variance
    return 0.5 * (covariance + covariance.T)


@kernel
def _gauss_newton(
    points: Points, anchors: Points, normals: Points, pose: Pose, repeats: int
) -> tuple[float, float, float]:
    """Solve the 3x3 normal equations by elimination about the centre of the points; NaN where singular."""
    x, y, theta = pose[0], pose[1], pose[2]
    for _ in range(repeats):
        c, s = np.cos(theta), np.sin(theta)
        a00, a01, a02, a11, a12, a22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        b0, b1, b2, square = 0.0, 0.0, 0.0, 0.0
        for i in range(points.shape[0]):
            rx = c * points[i, 0] - s * points[i, 1]
            ry = s * points[i, 0] + c * points[i, 1]
            nx, ny = normals[i, 0], normals[i, 1]
            lever = ny * rx - nx * ry
            error = nx * (rx + x - anchors[i, 0]) + ny * (ry + y - anchors[i, 1])
            square += rx * rx + ry * ry
            a00 += nx * nx
            a01 += nx * ny
            a02 += nx * lever
            a11 += ny * ny
            a12 += ny * lever
            a22 += lever * lever
            b0 -= nx * error
            b1 -= ny * error
            b2 -= lever * error
        a00 += DAMPING * points.shape[0]
        a11 += DAMPING * points.shape[0]
        a22 += DAMPING * square
        # symmetric elimination, translation first
        p01, p02 = a01 / a00, a02 / a00
        d11, d12 = a11 - p01 * a01, a12 - p01 * a02
        e1 = b1 - p01 * b0
        q12 = d12 / d11
        d22 = a22 - p02 * a02 - q12 * d12
        d_theta = (b2 - p02 * b0 - q12 * e1) / d22
        d_y = (e1 - d12 * d_theta) / d11
        d_x = (b0 - a01 * d_y - a02 * d_theta) / a00
        x += d_x
        y += d_y
        theta += d_theta
    return x, y, theta
