"""Gauss-Newton: against SciPy's dense least squares, and its laws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from curvescan import se2
from curvescan.slam.pose_graph.cholesky import Elimination
from curvescan.slam.pose_graph.optimization import Edges, linearized, optimize, squared_distances
from tests.slam.graphs import dead_reckoning, dense_information, ladder, loop, measured_edges

_ANCHOR = np.array([0])


def _residuals(poses: np.ndarray, edges: Edges) -> np.ndarray:
    """The slow twin: each edge's error in the frame of its first pose, whitened."""
    rows = []
    for (i, j), measured, information in zip(*edges, strict=True):
        error = se2.between(poses[i], poses[j]) - measured
        error[2] = se2.wrap(error[2])
        rows.append(np.linalg.cholesky(information).T @ error)
    return np.concatenate(rows)


def test_the_optimum_is_that_of_dense_least_squares() -> None:
    truth = loop(24)
    edges = measured_edges(truth, ladder(24), seed=1)
    start = dead_reckoning(edges, 24)
    found = optimize(start, edges, np.ones(len(edges.ends)), _ANCHOR, Elimination.of(edges.ends, 24))

    def residuals(free: np.ndarray) -> np.ndarray:
        return _residuals(np.vstack((np.zeros((1, 3)), free.reshape(-1, 3))), edges)

    dense = least_squares(residuals, start[1:].ravel(), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    # both stop below 1e-6: the two optima are the same point
    assert se2.between(found[1:], dense.x.reshape(-1, 3)) == pytest.approx(0.0, abs=1e-5)
    assert squared_distances(found, edges).sum() == pytest.approx(2.0 * dense.cost, rel=1e-6)


def test_squared_distances_are_those_of_the_whitened_residuals() -> None:
    truth = loop(12)
    edges = measured_edges(truth, ladder(12), seed=2)
    slow = (_residuals(truth, edges).reshape(-1, 3) ** 2).sum(axis=1)
    assert squared_distances(truth, edges) == pytest.approx(slow, rel=1e-9)


def test_normal_equations_are_jt_j_of_numerical_derivatives() -> None:
    truth = loop(8)
    edges = measured_edges(truth, ladder(8), seed=3)
    none = np.zeros(0, dtype=np.int64)
    weights = np.ones(len(edges.ends))
    step = 1e-6
    jac = np.column_stack(
        [
            (_residuals(truth + step * e.reshape(-1, 3), edges) - _residuals(truth - step * e.reshape(-1, 3), edges))
            / (2.0 * step)
            for e in np.eye(24)
        ]
    )
    matrix = dense_information(truth, edges, weights, none)
    # central differences of step 1e-6 are good to 1e-9 of the largest entry
    assert matrix == pytest.approx(jac.T @ jac, abs=1e-6 * np.abs(matrix).max())
    gradient = linearized(truth, *edges, weights)[1].ravel()
    assert gradient == pytest.approx(jac.T @ _residuals(truth, edges), abs=1e-3)
    assert matrix == pytest.approx(matrix.T, abs=1e-15 * np.abs(matrix).max())


def test_an_anchored_pose_stays_where_it_is() -> None:
    truth = loop(12)
    edges = measured_edges(truth, ladder(12), seed=4)
    start = truth + 0.01
    found = optimize(start, edges, np.ones(len(edges.ends)), np.array([5]), Elimination.of(edges.ends, 12))
    assert found[5] == pytest.approx(start[5], abs=1e-12)
    assert not np.allclose(found[0], start[0], atol=1e-4)


@pytest.mark.parametrize(("n", "away"), [(12, (13.0, 0.0, 0.05)), (40, (13.0, -5.0, 1.0))])
def test_parts_that_little_ties_are_not_led_astray_by_an_old_factorization(n: int, away: tuple[float, ...]) -> None:
    """Two chains that one step of hardly any weight ties; closures of the second are off by 13 m."""
    turn = np.full(2 * n, 0.12).cumsum()
    poses = np.column_stack((0.5 * np.cos(turn).cumsum(), 0.5 * np.sin(turn).cumsum(), se2.wrap(turn)))
    chains = [(a + k, a + k + d) for a in (0, n) for d in (1, 2, 3) for k in range(n - d)]
    false = [(n + k, 2 * n - 1 - k) for k in range(4)]
    ends = np.array([(n - 1, n), *chains, *false])
    measured = se2.between(poses[ends[:, 0]], poses[ends[:, 1]])
    measured[-4:] = se2.compose(measured[-4:], np.array(away))
    edges = Edges.of(ends, measured, np.tile(np.diag([0.006**2, 0.006**2, 0.002**2]), (len(ends), 1, 1)))
    weights, order = np.where(np.arange(len(ends)) == 0, 1e-4, 1.0), Elimination.of(ends, 2 * n)
    found = [poses]
    for _ in range(6):
        found.append(optimize(found[-1], edges, weights, _ANCHOR, order))
    first, *_, last = (float(weights @ squared_distances(one, edges)) for one in found[1:])
    assert first == pytest.approx(last, rel=1e-3)
