"""ATE, RPE and drift: against slow twins, against evo where it is installed, and by laws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import curvescan as cs
from curvescan.evaluation.trajectory_errors import Spread, align, ate, rpe, trajectory_errors, travelled
from tests.reference import trajectory_errors as slow

FRAME = st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(-3, 3)).map(np.array)


def drive(seed, n=150):
    """A random drive, and the same with errors that add up, in a frame of its own."""
    rng = np.random.default_rng(seed)
    motions = np.column_stack([rng.uniform(0.0, 0.4, n - 1), rng.normal(0.0, 0.02, n - 1), rng.normal(0.0, 0.3, n - 1)])
    wrong = motions + rng.normal(0.0, [0.01, 0.01, 0.02], motions.shape)

    def chain(steps):
        poses = [np.zeros(3)]
        for step in steps:
            poses.append(cs.se2.compose(poses[-1], step))
        return np.array(poses)

    return cs.se2.compose([3.0, -2.0, 2.5], chain(wrong)), chain(motions)


@pytest.fixture(scope="module")
def evo_core(tmp_path_factory):
    """Parts of evo; it makes a folder in the home folder when it is imported, so it gets another one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(tmp_path_factory.mktemp("home")))
        metrics = pytest.importorskip(
            "evo.core.metrics", reason="evo (GPL-3) is only compared with: pip install curvescan[evo]"
        )
        trajectory = pytest.importorskip("evo.core.trajectory")
    return metrics, trajectory


def as_evo(trajectory, poses):
    half = 0.5 * poses[:, 2]
    zero = np.zeros(len(poses))
    return trajectory.PoseTrajectory3D(
        positions_xyz=np.column_stack([poses[:, :2], zero]),
        orientations_quat_wxyz=np.column_stack([np.cos(half), zero, zero, np.sin(half)]),
        timestamps=np.arange(len(poses), dtype=float),
    )


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_ate_is_evos(evo_core, seed):
    metrics, trajectory = evo_core
    poses, truth = drive(seed)
    for alignment in ("best", "first"):
        own, goal = as_evo(trajectory, poses), as_evo(trajectory, truth)
        own.align(goal) if alignment == "best" else own.align_origin(goal)
        ape = metrics.APE(metrics.PoseRelation.translation_part)
        ape.process_data((goal, own))
        errors = ate(poses, truth, alignment)
        np.testing.assert_allclose(errors, ape.error, atol=1e-9)
        spread, figures = Spread.of(errors), ape.get_all_statistics()
        for name in ("mean", "std", "median", "rmse", "max"):
            assert getattr(spread, name) == pytest.approx(figures[name], abs=1e-9)


@pytest.mark.parametrize(("unit", "delta"), [("frames", 1), ("frames", 7), ("metres", 1.0), ("metres", 3.5)])
def test_rpe_is_evos(evo_core, unit, delta):
    metrics, trajectory = evo_core
    poses, truth = drive(3)
    own, goal = as_evo(trajectory, poses), as_evo(trajectory, truth)
    errors = rpe(poses, truth, delta=delta, unit=unit)
    relations = (metrics.PoseRelation.translation_part, metrics.PoseRelation.rotation_angle_rad)
    for relation, found in zip(relations, (errors.translation, errors.rotation), strict=True):
        evos = metrics.RPE(
            relation,
            delta=delta,
            delta_unit=metrics.Unit.frames if unit == "frames" else metrics.Unit.meters,
            pairs_from_reference=True,
        )
        evos.process_data((goal, own))
        # evo takes the angle from an arccos, which loses half of the digits near 0
        np.testing.assert_allclose(found, evos.error, atol=1e-7)


@pytest.mark.parametrize("alignment", ["best", "first"])
def test_ate_is_the_slow_one(alignment):
    poses, truth = drive(4)
    np.testing.assert_allclose(ate(poses, truth, alignment), slow.ate(poses, truth, alignment), atol=1e-10)


def test_rpe_is_the_slow_one():
    poses, truth = drive(5)
    for errors in (rpe(poses, truth), rpe(poses, truth, delta=1.0, unit="metres")):
        pairs = zip(errors.start, errors.stop, strict=True)
        expected = slow.rpe(poses, truth, list(pairs))
        np.testing.assert_allclose(errors.translation, expected[:, 0], atol=1e-10)
        np.testing.assert_allclose(errors.rotation, expected[:, 1], atol=1e-10)


def test_motions_by_path_are_at_least_as_long_and_no_longer_than_needed():
    _, truth = drive(6)
    length = travelled(truth)
    errors = rpe(truth, truth, delta=2.0, unit="metres")
    np.testing.assert_array_equal(errors.start[1:], errors.stop[:-1])
    assert np.all(length[errors.stop] - length[errors.start] >= 2.0 - 1e-9)
    assert np.all(length[errors.stop - 1] - length[errors.start] < 2.0)
    assert len(rpe(truth, truth, delta=1e6, unit="metres").translation) == 0


@given(FRAME)
def test_the_frame_does_not_matter(frame):
    poses, truth = drive(7, n=20)
    moved = cs.se2.compose(frame, poses)
    np.testing.assert_allclose(ate(moved, truth), ate(poses, truth), atol=1e-10)
    np.testing.assert_allclose(rpe(moved, truth).translation, rpe(poses, truth).translation, atol=1e-10)


def test_the_best_alignment_is_a_minimum():
    poses, truth = drive(8)
    best = align(poses, truth)
    least = np.mean(np.sum((best - truth)[:, :2] ** 2, axis=1))
    for change in np.vstack([np.eye(3), -np.eye(3)]) * 0.01:
        other = cs.se2.compose(change, best)
        assert np.mean(np.sum((other - truth)[:, :2] ** 2, axis=1)) > least


def test_drift_is_told_per_metre_and_per_turn():
    # ten metres straight on, one turn of 90 degrees; 1 % too far and a turn of 91 degrees
    truth = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 0.0, math.pi / 2]])
    found = np.array([[0.0, 0.0, 0.0], [10.1, 0.0, 0.0], [10.1, 0.0, math.radians(91)]])
    errors = trajectory_errors(found, truth)
    assert errors.drift == pytest.approx(0.01)
    assert errors.turn_drift == pytest.approx(1.0 / 90.0)
    assert errors.turn_per_metre == pytest.approx(math.radians(1.0) / 10.0)
    standing = trajectory_errors(truth[:1].repeat(2, axis=0), truth[:1].repeat(2, axis=0))
    assert math.isnan(standing.drift)
    assert math.isnan(standing.turn_drift)


def test_turns_that_go_wrong_by_more_than_half_a_turn_are_not_wrapped():
    turns = np.column_stack([np.zeros((101, 2)), cs.se2.wrap(np.radians(10.0) * np.arange(101))])
    more = np.column_stack([np.zeros((101, 2)), cs.se2.wrap(np.radians(12.0) * np.arange(101))])
    assert trajectory_errors(more, turns).turn_error == pytest.approx(math.radians(200.0))


def test_bad_arguments_are_refused():
    poses, truth = drive(9, n=5)
    with pytest.raises(cs.InvalidArgumentError, match=r"n >= 1, got \(5, 3\) and \(4, 3\)"):
        ate(poses, truth[:4])
    with pytest.raises(cs.InvalidArgumentError, match="delta must be positive"):
        rpe(poses, truth, delta=0.0)
    with pytest.raises(cs.InvalidArgumentError, match="whole number of frames"):
        rpe(poses, truth, delta=1.5)
    assert math.isnan(Spread.of(np.empty(0)).mean)
