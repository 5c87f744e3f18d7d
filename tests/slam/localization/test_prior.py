"""What is known before: an initial pose, and the last one moved by the odometry, as odds of places."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_t

import curvescan as cs
from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.odometry import StepOutcome
from curvescan.se2.uncertain import UncertainPose
from curvescan.simulation import World
from curvescan.slam import SlamMap
from curvescan.slam.localization.prior import Prior
from localization_drives import Drive, Localized, is_same, placements, read_drive

AREA = 200.0
SIGMA = np.array([0.4, 0.3, 0.2])


def test_the_odds_are_those_of_a_density_with_a_heavy_tail_against_a_uniform_one() -> None:
    rng = np.random.default_rng(2)
    spread = rng.normal(size=(3, 3)) * 0.1
    cov = np.diag(SIGMA**2) + spread @ spread.T
    prior = Prior.of([1.0, 2.0, 3.0], cov)
    off = rng.multivariate_normal(np.zeros(3), cov, 50)
    poses = np.array([1.0, 2.0, 3.0]) + off
    poses[:, 2] = se2.wrap(poses[:, 2])  # some lie beyond half a turn
    density = multivariate_t(np.zeros(3), cov, df=3).pdf(off) * AREA * 2.0 * np.pi
    expected = np.log((1.0 - np.exp(prior.astray)) * density + np.exp(prior.astray))
    assert np.allclose(prior.log_odds(poses, AREA), expected, atol=1e-9)


def test_a_far_place_is_less_likely_by_a_finite_factor_and_a_prior_wider_than_the_map_says_nothing() -> None:
    far = np.array([[50.0, 0.0, 0.0], [80.0, 9.0, 1.0]])
    assert np.allclose(Prior.of([0.0, 0.0, 0.0]).log_odds(far, AREA), np.log(0.01))
    lost = Prior.of([0.0, 0.0, 0.0], np.diag([1e6, 1e6, 30.0]))
    assert np.abs(lost.log_odds(far, AREA)).max() < 0.1


def test_matches_make_a_prior_surer_and_motions_that_nothing_measured_less_sure() -> None:
    here, step = UncertainPose(np.zeros(3), np.diag(SIGMA**2)), UncertainPose(np.ones(3), np.eye(3) * 1e-4)
    first = Prior(here=here)
    sure = first.confirmed(here, 0.3)
    assert sure.astray < first.astray
    assert first.confirmed(here, -0.1).astray == first.astray
    for _ in range(100):
        sure = sure.confirmed(here, 0.4)
    assert np.isfinite(sure.log_odds(np.full((1, 3), 90.0), AREA)).all()
    assert sure.moved(step, is_doubtful=False).astray == sure.astray
    doubted = sure.moved(step, is_doubtful=True)
    assert np.exp(doubted.astray) == pytest.approx(0.1)
    for _ in range(1000):
        doubted = doubted.moved(step, is_doubtful=True)
    assert np.isfinite(doubted.log_odds(np.full((1, 3), 0.5), AREA)).all()


@pytest.mark.parametrize(
    ("pose", "covariance", "rule"),
    [
        ([1.0, 2.0], None, "initial_pose.pose must be three finite numbers"),
        ([1.0, 2.0, np.nan], None, "initial_pose.pose must be three finite numbers"),
        ([1.0, 2.0, 3.0], np.eye(2), r"initial_pose.covariance must be \(3, 3\)"),
        ([1.0, 2.0, 3.0], np.triu(np.ones((3, 3))), "covariance must be symmetric"),
        ([1.0, 2.0, 3.0], np.diag([1.0, 1.0, 0.0]), "covariance must be positive definite"),
    ],
)
def test_what_is_no_pose_or_no_covariance_is_refused(pose: Any, covariance: Any, rule: str) -> None:
    with pytest.raises(InvalidArgumentError, match=rule):
        Prior.of(pose, covariance)


HALL = World(
    name="hall that looks the same from both ends",
    walls=np.array([[0.0, 0.0, 9.0, 0.0], [9.0, 0.0, 9.0, 5.0], [9.0, 5.0, 0.0, 5.0], [0.0, 5.0, 0.0, 0.0]]),
    boxes=np.array(
        [[2.0, 0.5, 1.2, 0.6, 0.0], [7.0, 4.5, 1.2, 0.6, 0.0], [0.5, 3.2, 0.5, 1.4, 0.0], [8.5, 1.8, 0.5, 1.4, 0.0]]
    ),
    circles=np.array([[3.0, 3.4, 0.2], [6.0, 1.6, 0.2]]),
)


def _hall_way(n: int = 120) -> np.ndarray:
    angle = np.linspace(0.3, 0.3 + 2.0 * np.pi, n)
    x, y = 4.5 + 1.0 * np.cos(angle), 2.5 + 1.5 * np.sin(angle)
    return np.column_stack((x, y, np.arctan2(1.5 * np.cos(angle), -np.sin(angle))))


def _scans(world: World, poses: np.ndarray, seed: int) -> list[cs.LaserScan]:
    return list(cs.simulate(world, poses=poses, seed=seed, odometry_noise=None))


def _mapped(world: World, poses: np.ndarray) -> SlamMap:
    slam = cs.Slam()
    for scan in _scans(world, poses, seed=1):
        slam.add(scan)
    slam.finish()
    return slam.map


@pytest.mark.slow
@pytest.mark.parametrize("end", [0.0, np.pi])
def test_an_initial_pose_decides_between_two_ends_that_look_alike(end: float) -> None:
    way = _hall_way()
    slam_map, later = _mapped(HALL, way), _hall_way()[10:40] + np.array([0.05, 0.02, 0.0])
    localizer = cs.Localizer(slam_map)
    seen = _scans(HALL, later, seed=5)
    assert not any(localizer.add(scan).ok for scan in seen)  # nothing tells the two ends apart
    # the whole hall, turned by half a turn about its middle, looks the same
    about = np.array([4.5, 2.5, 0.0])
    turned = se2.compose(se2.compose(about, np.array([0.0, 0.0, end])), se2.between(about, later))
    true = se2.between(way[0], turned)
    off = np.array([0.8, 0.6, np.radians(20.0)])  # 1 m and 20 deg
    localizer.reset(true[0] + off, np.diag(np.square([0.7, 0.7, np.radians(15.0)])))
    steps = [localizer.add(scan) for scan in seen]
    assert steps[0].ok
    errors = np.array([np.hypot(*(step.pose - pose)[:2]) for step, pose in zip(steps, true, strict=True)])
    assert errors.max() < 0.1
    # and it is forgotten again
    localizer.reset()
    assert not any(localizer.add(scan).ok for scan in seen)


CORRIDOR = World(
    name="corridor with a door every three metres, and one end",
    walls=np.array(
        [[0.0, 0.0, 0.0, 2.0], [0.0, 2.0, 48.0, 2.0]]
        + [[x, 0.0, x + 2.0, 0.0] for x in np.arange(0.0, 48.0, 3.0)]
        + [[x + 2.0, 0.0, x + 2.0, -0.6] for x in np.arange(0.0, 48.0, 3.0)]
        + [[x + 2.0, -0.6, x + 3.0, -0.6] for x in np.arange(0.0, 48.0, 3.0)]
        + [[x + 3.0, -0.6, x + 3.0, 0.0] for x in np.arange(0.0, 48.0, 3.0)]
    ),
    boxes=np.array([[1.2, 1.7, 0.8, 0.5, 0.2], [4.2, 1.8, 0.5, 0.3, 0.0], [10.0, 1.8, 0.4, 0.3, 0.0]]),
    circles=np.empty((0, 3)),
)


@pytest.mark.slow
def test_a_sensor_that_leaves_the_map_along_doors_that_repeat_is_not_put_back_into_it() -> None:
    def way(*ends: float) -> np.ndarray:
        x = np.concatenate([np.arange(a, b, 0.12 * np.sign(b - a)) for a, b in pairwise(ends)])
        return np.column_stack((x, 1.0 + 0.1 * np.sin(x), np.zeros_like(x)))

    mapped, later = way(1.0, 14.0), way(2.0, 34.0, 3.0)
    slam = cs.Slam()
    log = cs.simulate(CORRIDOR, poses=mapped, seed=1)
    for scan, pose in zip(log, log.odometry.poses, strict=True):
        slam.add(scan, pose)
    slam.finish()
    localizer = cs.Localizer(slam.map)
    drive = cs.simulate(CORRIDOR, poses=later, seed=2)
    steps = [localizer.add(scan, pose) for scan, pose in zip(drive, drive.odometry.poses, strict=True)]
    true = se2.between(mapped[0], later)
    errors = np.array([np.hypot(*(step.pose - pose)[:2]) for step, pose in zip(steps, true, strict=True)])
    assert np.nanmax(errors) < 1.5  # a door is three metres away
    assert any(step.outcome is StepOutcome.PREDICTED for step in steps)
    assert np.isfinite(errors[-40:]).all()
    assert errors[-20:].max() < 0.3


@pytest.mark.slow
def test_drives_along_real_doors_that_repeat_are_never_found_elsewhere(real_data: Path) -> None:
    # by rules without a prior two of four fixes of this pair were 12 m off
    drive, other = (read_drive(real_data / f"cmu-wean-hall/robotdata{k}.log.gz") for k in (2, 1))
    slam_map = cs.run(other, engine="slam").map
    assert isinstance(slam_map, SlamMap)
    run = cs.localize(drive, slam_map)
    way = cs.run(drive, engine="slam").trajectory.poses
    found = Localized(
        outcomes=tuple(step.outcome for step in run.steps),
        poses=np.array([step.pose for step in run.steps]),
        seconds=np.zeros(len(way)),
    )
    placed = Drive(log=drive, slam_map=slam_map, poses=way)
    known = found.is_known
    assert known.mean() > 0.6
    # the drive begins where the map is unlike any other place
    reference = placements(placed, found, np.array([int(np.argmax(known))]))[0]
    assert is_same(placed, found, reference)[known].all()
