"""The Cramér-Rao bound: its gradient against finite differences, the bound against a Monte Carlo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from curvescan import se2
from curvescan.benchmarks.scenarios import (
    OPEN_WORLDS,
    SCENARIOS,
    median_error,
    pair_bound,
    range_gradient,
    score_open,
    score_scenario,
)
from curvescan.simulation import SENSORS, World, build_world, simulate_pairs
from curvescan.simulation.sensing.sensors import cast_beams

LMS = SENSORS["sick-lms200"]


def cast(world, pose, sensor=LMS):
    return cast_beams(world, pose, sensor)


@pytest.mark.parametrize("name", ["room", "round-room", "clutter"])
def test_the_gradient_is_that_of_the_ranges(name):
    world = build_world(name, 3)
    pose = np.array([0.3, -0.2, 0.7])
    ranges, gradient = range_gradient(world, pose, LMS)
    np.testing.assert_array_equal(ranges, cast(world, pose)[0])
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-6
        ahead, behind = (cast(world, se2.compose(pose, s * step)) for s in (1, -1))
        # beams that change from one surface to another have no gradient
        same = (ahead[1] == behind[1]) & (ahead[1] >= 0)
        slope = (ahead[0] - behind[0])[same] / 2e-6
        assert np.count_nonzero(same) > 50
        # central differences of 1e-6 leave about eight digits, grazing beams fewer
        np.testing.assert_allclose(gradient[same, axis], slope, rtol=1e-3, atol=1e-5)


def fit_walls_and_pose(scans, walls, wall_of_beam, angles, start):
    """Maximum likelihood of the pose of scan 1 in scan 0 and of all walls, by Gauss-Newton."""
    parameters = np.concatenate([start, walls.ravel()])

    def predict(p):
        lines = p[3:].reshape(-1, 2)
        out = []
        for k, pose in enumerate((np.zeros(3), p[:3])):
            line = lines[wall_of_beam[k]]
            normal = np.stack([np.cos(line[:, 0]), np.sin(line[:, 0])], axis=1)
            heading = angles + pose[2]
            beams = np.stack([np.cos(heading), np.sin(heading)], axis=1)
            out.append((line[:, 1] - normal @ pose[:2]) / np.sum(normal * beams, axis=1))
        return np.concatenate(out)

    measured = np.concatenate(scans)
    for _ in range(3):
        at = predict(parameters)
        jacobian = np.empty((at.size, parameters.size))
        for j in range(parameters.size):
            shifted = parameters.copy()
            shifted[j] += 1e-6
            jacobian[:, j] = (predict(shifted) - at) / 1e-6
        parameters = parameters + np.linalg.lstsq(jacobian, measured - at, rcond=None)[0]
    return parameters[:3]


@pytest.mark.slow
def test_the_bound_is_reached_by_the_best_estimate_there_is():
    # a room of four walls, whose lines are estimated with the pose: nothing is known but that walls are straight
    sensor = replace(LMS, range_max=30.0, dropout=0.0)
    world = World(walls=[[-4, -3, 5, -3], [5, -3, 5, 4], [5, 4, -4, 4], [-4, 4, -4, -3]])
    motion = np.array([0.1, 0.05, 0.08])
    pair = simulate_pairs(world, sensor=sensor, motions=[motion], seed=2)[0]
    bound = pair_bound(pair, sensor)

    poses = (pair.reference_pose, se2.compose(pair.reference_pose, motion))
    exact, hits = zip(*(cast(world, pose, sensor) for pose in poses), strict=True)
    lines = []
    for x0, y0, x1, y1 in se2_lines(world, poses[0]):
        normal = np.array([y1 - y0, x0 - x1]) / np.hypot(x1 - x0, y1 - y0)
        lines.append([np.arctan2(normal[1], normal[0]), normal @ [x0, y0]])
    angles = sensor.angle_min + sensor.angle_increment * np.arange(sensor.n_beams)
    seen = np.unique(np.concatenate(hits))
    walls = np.array(lines)[seen]
    wall_of_beam = [np.searchsorted(seen, h) for h in hits]

    rng = np.random.default_rng(1)
    errors = []
    for _ in range(400):
        noisy = [r + sensor.sigma_range * rng.standard_normal(r.size) for r in exact]
        errors.append(fit_walls_and_pose(noisy, walls, wall_of_beam, angles, motion) - motion)
    sample = np.cov(np.array(errors).T)
    # 400 runs know a standard deviation to 3.5 %; and this estimate may use that a wall goes on straight where only
    # one of the scans sees it, which the bound does not and which is worth up to a seventh
    np.testing.assert_allclose(np.sqrt(np.diag(sample)), np.sqrt(np.diag(bound)), rtol=0.2)


def se2_lines(world, pose):
    inverse = se2.inverse(pose)
    starts = se2.transform(inverse, world.segments[:, :2])
    ends = se2.transform(inverse, world.segments[:, 2:])
    return np.hstack([starts, ends])


def test_a_bare_corridor_has_no_bound():
    pair = replace(simulate_pairs("bare-corridor", n_pairs=1, seed=1), sight_share=0.3)[0]
    bound = pair_bound(pair, LMS)
    assert np.isnan(bound).all() or np.linalg.eigvalsh(bound)[-1] > 0.01


def test_the_median_error_of_a_bound_is_that_of_its_normal():
    # of a circular normal of deviation s in the plane the median distance is 1.1774 s
    bound = np.diag([1e-6, 1e-6, 1e-8])
    assert median_error([bound] * 200) == pytest.approx(1.1774e-3, rel=0.02)
    assert np.isnan(median_error([np.full((3, 3), np.nan)]))


def test_cells_are_scored_on_the_same_pairs():
    [alone] = score_scenario(SCENARIOS[0], ["cfsma"], n_pairs=4)
    ours, beside = score_scenario(SCENARIOS[0], ["curvescan", "cfsma"], n_pairs=4)
    assert beside == alone
    assert (ours.success, ours.false_positives) == (1.0, 0.0)
    assert alone.success + alone.false_positives <= 1.0
    assert 0.0003 < alone.bound == ours.bound < 0.005


@pytest.mark.slow
@pytest.mark.parametrize("world", OPEN_WORLDS)
def test_the_default_matcher_names_what_stays_open(world):
    [score] = score_open(world, ["curvescan"], n_pairs=30)
    # a bare corridor looks the same both ways round: some matches are ambiguous without a guess
    assert score.ok > (0.7 if world == "bare-corridor" else 0.9)
    assert score.flagged > 0.95
    assert score.nees_median < 3.0
