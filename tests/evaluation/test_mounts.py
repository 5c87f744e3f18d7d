"""Mounts found from motions: right, and with a covariance that says how right."""

from __future__ import annotations

import json

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.cli.main import run as command
from curvescan.errors import InvalidArgumentError
from curvescan.evaluation.mounts import check_mounts, common_motions, find_mount, find_mounts
from tests.engines.test_rig import MOUNTS, recorded, rig_bag


def motions(rng, mount, n=60, sigma=0.004, sigma_rad=0.002):
    """Motions of two sensors on one body over n pieces of a winding drive, each with noise of its own."""
    a = np.stack([rng.uniform(0.2, 0.4, n), rng.normal(0.0, 0.02, n), rng.normal(0.0, 0.3, n)], axis=-1)
    b = se2.compose(se2.compose(se2.inverse(mount), a), mount)
    noise = np.array([sigma, sigma, sigma_rad])
    return a + noise * rng.standard_normal((n, 3)), b + noise * rng.standard_normal((n, 3))


def test_a_mount_is_found_with_a_covariance_that_says_how_well():
    rng = np.random.default_rng(5)
    nees = []
    for _ in range(100):
        mount = np.array([*rng.uniform(-0.6, 0.6, 2), rng.uniform(-np.pi, np.pi)])
        found = find_mount(*motions(rng, mount))
        error = found.pose - mount
        error[2] = se2.wrap(error[2])
        nees.append(error @ np.linalg.solve(found.covariance, error))
    # chi-square with 3 degrees of freedom, mean of 100: 3 with a deviation of 0.25; residuals of a median add some
    assert 2.0 < np.mean(nees) < 4.2


def test_pieces_that_slipped_do_not_move_it():
    rng = np.random.default_rng(6)
    mount = np.array([0.4, -0.2, 2.0])
    a, b = motions(rng, mount)
    a[::15] += (0.3, 0.1, 0.0)
    assert np.abs(find_mount(a, b).pose - mount).max() < 0.02


def test_motions_are_cut_into_the_same_pieces_for_sensors_of_other_rates():
    stamps = 0.1 * np.arange(50)
    path = se2.exp(stamps[:, None] * np.array([0.5, 0.0, 0.1]))
    slow = cs.Trajectory(stamps=stamps[::2], poses=path[::2])
    a, b = common_motions(slow, cs.Trajectory(stamps=stamps, poses=path))
    assert len(a) == len(b) > 5
    assert np.allclose(a, b)


@pytest.mark.parametrize(
    ("a", "b", "sentence"),
    [
        (np.zeros((9, 3)), np.zeros((8, 3)), "two arrays of shape"),
        (np.ones((3, 3)), np.ones((3, 3)), "needs 8 motions"),
        (np.tile([1.0, 0.0, 0.0], (20, 1)), np.tile([1.0, 0.0, 0.0], (20, 1)), "round bends"),
        (np.tile([0.0, 0.0, 0.3], (20, 1)), np.tile([0.0, 0.0, 0.3], (20, 1)), "6.00 rad and 0.00 m: drive farther"),
    ],
)
def test_too_little_to_tell_is_said(a, b, sentence):
    with pytest.raises(InvalidArgumentError, match=sentence):
        find_mount(a, b)


@pytest.mark.slow
def test_the_mount_of_a_simulated_laser_is_found_from_its_scans():
    drive = cs.simulate("office", n_scans=120, seed=3)
    logs = recorded(drive.truth.poses, world=drive.world)
    true = se2.between(np.array(MOUNTS["front"]), np.array(MOUNTS["rear"]))
    found = find_mounts(logs, base="front")["rear"]
    error = found.pose - true
    error[2] = se2.wrap(error[2])
    # a mount wrong by 5 cm or 2 deg must show
    assert np.abs(error[:2]).max() < 0.03
    assert abs(error[2]) < np.radians(1.0)
    with pytest.raises(InvalidArgumentError, match="base must be one of front, rear"):
        find_mounts(logs, base="left")


@pytest.mark.slow
def test_a_bag_with_a_wrong_mount_is_told(tmp_path, capsys):
    drive = cs.simulate("office", n_scans=120, seed=3)
    logs = recorded(drive.truth.poses, world=drive.world)
    wrong = {"front": MOUNTS["front"], "rear": np.add(MOUNTS["rear"], (0.05, 0.0, np.radians(2.0)))}
    for name, mounts, status in (("right", MOUNTS, 0), ("wrong", wrong, 3)):
        bag = rig_bag(tmp_path / name, logs, mounts)
        [check] = check_mounts(bag)
        assert (check.topic, check.base) == ("/rear", "/front")
        assert check.is_wrong == (status == 3)
        assert command(["calibrate", str(bag), "--mounts"]) == status
        assert name in capsys.readouterr().out
        assert command(["info", str(bag), "--rig", "--json"]) == 0
        kinds = [issue["kind"] for issue in json.loads(capsys.readouterr().out)["issues"]]
        assert ("wrong_mount" in kinds) == (name == "wrong")
        assert command(["info", str(bag), "--rig"]) == 0
        said = " ".join(capsys.readouterr().out.split())
        assert ("the transforms put /rear elsewhere" in said) == (name == "wrong")
        assert ("the scans agree with the transforms" in said) == (name == "right")


def test_poses_that_are_not_known_are_left_out():
    stamps = 0.1 * np.arange(50)
    path = se2.exp(stamps[:, None] * np.array([0.5, 0.0, 0.1]))
    wheels = cs.Trajectory(stamps=stamps, poses=np.where(stamps[:, None] < 0.25, np.nan, path))
    a, b = common_motions(wheels, cs.Trajectory(stamps=stamps, poses=path))
    assert len(a) > 5
    assert np.allclose(a, b)
