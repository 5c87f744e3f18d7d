"""Odometry: the chain of matches, what it does when a match fails, and the run over a log."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.engines import run_engine
from curvescan.odometry import KeyframesConfig, MotionConfig, OdometryConfig, StepOutcome
from curvescan.simulation import SENSORS, build_world
from tests.reference.se2 import compose_covariance
from tests.scenes import room_ranges, room_scan

STEP = np.array([0.05, 0.02, 0.04])


def drive(n, sigma=0.003):
    """Scans and true poses of a sensor that repeats one motion in the room."""
    poses = [np.zeros(3)]
    for _ in range(n - 1):
        poses.append(cs.se2.compose(poses[-1], STEP))
    scans = [room_scan(p, sigma=sigma, seed=k, stamp=0.1 * k) for k, p in enumerate(poses)]
    return scans, np.array(poses)


def blank(stamp=0.0):
    return cs.LaserScan(np.full(361, np.nan), angle_min=-math.pi / 2, angle_increment=math.pi / 360, stamp=stamp)


def test_poses_are_the_chain_of_the_matches():
    scans, _ = drive(6)
    odometry = cs.Odometry(config=OdometryConfig.scan_to_scan())
    steps = [odometry.add(scan) for scan in scans]
    assert [s.index for s in steps] == list(range(6))
    assert steps[0].outcome is StepOutcome.STARTED
    assert steps[0].match is None
    np.testing.assert_array_equal(steps[0].pose, 0.0)
    np.testing.assert_array_equal(steps[0].covariance, 0.0)
    pose, cov = np.zeros(3), np.zeros((3, 3))
    motion = np.zeros(3)
    for before, after, step in zip(scans, scans[1:], steps[1:], strict=False):
        result = cs.match(before, after, guess=motion)
        motion = result.pose
        assert result.ok
        cov = compose_covariance(pose, cov, result.pose, result.covariance)
        pose = cs.se2.compose(pose, result.pose)
        np.testing.assert_allclose(step.pose, pose, atol=1e-12)
        np.testing.assert_allclose(step.covariance, cov, rtol=1e-9)
        assert step.outcome is StepOutcome.MATCHED


def test_a_failed_match_repeats_the_last_motion_and_says_so():
    scans, _ = drive(4)
    odometry = cs.Odometry(config=OdometryConfig.scan_to_scan())
    steps = [odometry.add(scan) for scan in [*scans[:3], blank(), scans[3]]]
    predicted, after = steps[3], steps[4]
    assert predicted.outcome is StepOutcome.PREDICTED
    assert predicted.match.outcome is cs.Outcome.NO_SEGMENTS
    motion = cs.se2.between(steps[1].pose, steps[2].pose)
    np.testing.assert_allclose(predicted.pose, cs.se2.compose(steps[2].pose, motion), atol=1e-12)
    assert (np.diag(predicted.covariance) > np.diag(steps[2].covariance)).all()
    # a covered sensor is no reference: the scan after it is matched with the one before it
    assert after.outcome is StepOutcome.MATCHED
    # the guess is the way since the scan before: the motion predicted for the covered one, and the next
    direct = cs.match(scans[2], scans[3], guess=cs.se2.compose(motion, motion))
    expected = cs.se2.compose(steps[2].pose, direct.pose)
    np.testing.assert_allclose(after.pose, expected, atol=1e-12)
    assert (np.diag(after.covariance) < np.diag(predicted.covariance)).all()


def other_room(pose, **kwargs):
    """A place with nothing in common with the room: a long wall without a corner."""
    angles = -0.7 + 0.005 * np.arange(281)
    return cs.LaserScan((3.0 - pose[0]) / np.cos(angles), angle_min=-0.7, angle_increment=0.005, **kwargs)


def test_the_failed_scan_becomes_the_next_reference():
    scans, _ = drive(3)
    odometry = cs.Odometry(method="cfsma")  # which fails where nothing has corners
    for scan in [*scans[:2], other_room(STEP)]:
        step = odometry.add(scan)
    assert step.outcome is StepOutcome.PREDICTED
    assert odometry.add(scans[2]).outcome is StepOutcome.PREDICTED
    assert odometry.add(scans[2]).outcome is StepOutcome.MATCHED


def test_a_motion_is_not_repeated_for_ever():
    scans, _ = drive(3)
    odometry = cs.Odometry(config=OdometryConfig(motion=MotionConfig(max_repeats=2)))
    for scan in scans:
        odometry.add(scan)
    steps = [odometry.add(blank()) for _ in range(4)]
    assert [s.outcome for s in steps] == [StepOutcome.PREDICTED] * 2 + [StepOutcome.HELD] * 2
    np.testing.assert_array_equal(steps[3].pose, steps[1].pose)
    assert (np.diag(steps[3].covariance) > np.diag(steps[2].covariance)).all()
    # held for two scans: in fact it may have gone on as before
    assert np.trace(steps[3].covariance[:2, :2]) > (2.0 * np.hypot(*steps[1].motion[:2])) ** 2


@pytest.mark.parametrize("n_covered", [6, 12])
def test_a_sensor_that_was_covered_is_found_again_and_no_track_begins_under_the_cover(n_covered):
    log = cs.simulate("office", n_scans=50, seed=4)
    covered, steps, odometry, rng = range(20, 20 + n_covered), [], cs.Odometry(), np.random.default_rng(0)
    for k, scan in enumerate(log):
        waves = np.sin(np.arange(1, 6)[:, np.newaxis] * scan.angles + rng.uniform(0.0, 6.0, (5, 1)))
        near = 0.3 + 0.03 * waves.sum(axis=0)  # a hand, of another shape each time
        steps.append(odometry.add(replace(scan, ranges=near) if k in covered else scan))
    assert StepOutcome.LOST not in [step.outcome for step in steps]
    assert steps[covered.stop].outcome is StepOutcome.RELOCALIZED
    off = cs.se2.between(cs.se2.between(log.truth.poses[0], log.truth.poses[-1]), steps[-1].pose)
    assert np.hypot(*off[:2]) < 0.05


def test_a_first_scan_without_readings_gives_way_to_the_first_with_some():
    scans, _ = drive(2)
    odometry = cs.Odometry()
    steps = [odometry.add(scan) for scan in [blank(), scans[0], scans[1]]]
    assert [s.outcome for s in steps] == [StepOutcome.STARTED, StepOutcome.PREDICTED, StepOutcome.MATCHED]


def test_a_run_collects_every_step():
    scans, truth = drive(12)
    pose_keyframe_scan = []
    run = run_engine(scans, on_step=lambda step: pose_keyframe_scan.append(step.index))
    assert pose_keyframe_scan == list(range(12))
    assert len(run.trajectory) == len(run.outcomes) == run.seconds.size == run.n_matched.size == 12
    np.testing.assert_array_equal(run.trajectory.stamps, [s.stamp for s in scans])
    assert not run.is_partial
    assert run.n_matched[0] == 0
    assert (run.seconds > 0).all()
    # 3 mm of noise on 361 readings: half a millimetre a match, and two keyframes on the way
    error = cs.se2.between(truth[-1], run.trajectory.poses[-1])
    assert np.hypot(*error[:2]) < 0.003
    assert abs(error[2]) < math.radians(0.1)


def test_a_run_repeats_to_the_bit():
    scans, _ = drive(8)
    first, second = run_engine(scans), run_engine(scans)
    np.testing.assert_array_equal(first.trajectory.poses, second.trajectory.poses)
    np.testing.assert_array_equal(first.trajectory.covariances, second.trajectory.covariances)


def test_a_run_counts_failures_by_reason():
    scans, _ = drive(4)
    run = run_engine([*scans, blank(), blank()])
    assert run.failures == {cs.Outcome.NO_SEGMENTS: 2}


@pytest.mark.parametrize("engine", [cs.Odometry, cs.Slam])
def test_who_changes_the_arrays_of_a_step_changes_no_later_one(engine):
    scans = list(cs.simulate("office", n_scans=14, seed=4))
    scans[5] = scans[6] = blank(scans[5].stamp)  # the last motion is repeated
    engines = engine(), engine()
    for scan in scans:
        steps = [one.add(scan) for one in engines]
        np.testing.assert_array_equal(steps[1].pose, steps[0].pose)
        np.testing.assert_array_equal(steps[1].covariance, steps[0].covariance)
        for name, value in vars(steps[0]).items():
            if isinstance(value, np.ndarray):
                value[...] = 7.0
                assert all(getattr(steps[0], other) is not value for other in vars(steps[0]) if other != name)


def test_an_interrupt_keeps_what_there_is():
    scans, _ = drive(6)

    def interrupted():
        yield from scans[:4]
        raise KeyboardInterrupt

    run = run_engine(interrupted())
    assert run.is_partial
    assert len(run.trajectory) == len(run.outcomes) == 4


def test_no_scans_give_an_empty_run():
    run = run_engine([])
    assert len(run.trajectory) == 0
    assert run.trajectory.covariances.shape == (0, 3, 3)


def test_wrong_arguments_are_named():
    with pytest.raises(cs.InvalidArgumentError, match="unknown method 'slam'"):
        cs.Odometry(method="slam")
    with pytest.raises(cs.InvalidArgumentError, match="scan must be a LaserScan"):
        cs.Odometry().add(np.ones(3))
    with pytest.raises(cs.InvalidArgumentError, match="odometry_pose must be three numbers"):
        cs.Odometry().add(blank(), odometry_pose=[0.0, 1.0])
    with pytest.raises(cs.InvalidArgumentError, match=r"odometry must be three numbers .*got \(0.0, inf, 0.0\)"):
        replace(blank(), odometry=(0.0, np.inf, 0.0))
    with pytest.raises(cs.InvalidArgumentError, match="recovery_sigma_m must be > 0, got 0"):
        MotionConfig(recovery_sigma_m=0)
    with pytest.raises(cs.InvalidArgumentError, match="must not be less than least_sigma_m"):
        MotionConfig(sigma_m=0.01)
    with pytest.raises(cs.InvalidArgumentError, match="max_repeats must be >= 0, got -1"):
        MotionConfig(max_repeats=-1)
    with pytest.raises(cs.InvalidArgumentError, match=r"variance_retained must lie in \(0, 1\], got 0"):
        KeyframesConfig(variance_retained=0)


def test_the_first_scan_has_no_match_that_could_fail():
    scans, _ = drive(3)
    run = run_engine([*scans, blank()])
    assert run.is_failed.tolist() == [False, False, False, True]
    assert run.is_matched.tolist() == [False, True, True, False]
    assert run_engine([]).is_failed.size == 0


def in_the_office(seed, n, n_people=0, **kwargs):
    log = cs.simulate("office", n_scans=n, n_people=n_people, seed=seed, **kwargs)
    return list(log), log.truth.poses


@pytest.mark.slow
def test_standing_still_does_not_drift():
    _, somewhere = in_the_office(4, 1)
    scans, _ = in_the_office(4, 150, n_people=4, poses=np.tile(somewhere, (150, 1)))
    run = run_engine(scans)
    # the error is that of single matches, and does not grow: 5 mm and 0.1 deg hold at the end as at the beginning
    assert np.hypot(*run.trajectory.poses[:, :2].T).max() < 0.005
    assert np.abs(run.trajectory.poses[:, 2]).max() < math.radians(0.1)
    assert run.outcomes.count(StepOutcome.MATCHED) >= 148
    np.testing.assert_array_less(np.trace(run.trajectory.covariances[-1]), 1e-4)


@pytest.mark.slow
def test_slow_driving_does_not_pile_up_noise():
    """Half a millimetre a scan for 10 cm: the chain from scan to scan walks about, a keyframe does not."""
    ends = {"keys": [], "last": []}
    for seed in range(5):
        _, (start,) = in_the_office(seed, 1)
        way = cs.se2.compose(start, np.outer(np.arange(200), [0.0005, 0.0, 0.0]))
        scans, truth = in_the_office(seed, 200, n_people=2, poses=way)
        for name, config in (("keys", OdometryConfig()), ("last", OdometryConfig.scan_to_scan())):
            run = run_engine(scans, cs.Odometry(config=config))
            off = run.trajectory.poses - cs.se2.between(truth[0], truth)
            ends[name].append(np.hypot(*off[-50:, :2].T).mean())
    assert np.median(ends["keys"]) < 0.5 * np.median(ends["last"])


def test_a_covered_sensor_finds_itself_again():
    scans, truth = in_the_office(2, 90)
    run = run_engine([*scans[:40], *[blank()] * 8, *scans[48:]])
    assert set(run.outcomes[40:48]) <= {StepOutcome.PREDICTED, StepOutcome.HELD}
    after = run.outcomes[48]
    assert after in (StepOutcome.MATCHED, StepOutcome.RELOCALIZED)
    error = cs.se2.between(cs.se2.between(truth[0], truth[-1]), run.trajectory.poses[-1])
    assert np.hypot(*error[:2]) < 0.03
    # what was not known meanwhile was said to be
    sigma = np.sqrt(run.trajectory.covariances[:, 0, 0])
    assert sigma[47] > 10 * sigma[39]
    assert sigma[60] < 3 * sigma[39]


@pytest.mark.slow
def test_along_a_bare_corridor_the_wheels_decide_and_across_it_the_laser():
    log = cs.simulate("bare-corridor", n_scans=60, seed=5)
    truth = cs.se2.between(log.truth.poses[0], log.truth.poses)
    alone = run_engine(log).trajectory
    odometry_pose = log.odometry.poses.copy()
    odometry_pose[:, 1] += 0.004 * np.arange(60)  # wheels that skid sideways
    helped = run_engine(log, odometry_poses=odometry_pose).trajectory
    error = helped.poses - truth
    assert np.abs(error[:, 1]).max() < 0.02  # the walls tell
    assert np.abs(error[:, 0]).max() < 0.3  # 10 % of 7 m at most
    assert np.abs(alone.poses[-1, 0] - truth[-1, 0]) > 1.0  # nothing tells
    # and either says how sure it is
    assert alone.covariances[-1, 0, 0] > 1.0
    assert helped.covariances[-1, 0, 0] < 0.3**2
    assert np.abs(error[-1, 0]) < 3.0 * np.sqrt(helped.covariances[-1, 0, 0])


def test_the_end_of_a_corridor_that_is_carried_away_does_not_take_the_track_along():
    """Nothing else shows the way there: as when a sensor tips and sees the floor, or a board is carried ahead of it."""
    angles, rng, odometry = np.radians(np.arange(-90.0, 90.0)), np.random.default_rng(4), cs.Odometry()
    for k in range(80):
        x = 0.086 * k
        end = {60: 6.0, 61: 7.2, 62: 8.4}.get(k, 10.0 - x if k < 60 else 70.0)
        ranges = room_ranges((x, 0.0, 0.0), angles, (-20.0, -1.0, x + end, 1.0)) + rng.normal(0.0, 0.008, 180)
        scan = cs.LaserScan(
            ranges, angle_min=angles[0], angle_increment=math.radians(1.0), range_max=30.0, stamp=0.44 * k
        )
        step = odometry.add(scan)
    np.testing.assert_allclose(step.pose, [x, 0.0, 0.0], atol=0.1)  # of 7 m


def test_wheels_that_know_only_the_turn_are_taken_for_that():
    """A gyro: it tells a fast turn that the last motion does not."""
    scans, _ = drive(6)
    turned = cs.se2.compose(np.array([0.2, 0.1, 0.16]), np.array([0.0, 0.0, 1.2]))
    scans.append(room_scan(turned, sigma=0.003, seed=99))
    gyro = np.array([[np.nan, np.nan, 0.04 * k] for k in range(6)] + [[np.nan, np.nan, 1.36]])
    run = run_engine(scans, odometry_poses=gyro)
    assert run.outcomes[-1] in (StepOutcome.MATCHED, StepOutcome.CHAINED)
    np.testing.assert_allclose(run.trajectory.poses[-1], turned, atol=0.02)


@pytest.mark.slow
def test_covariances_are_consistent_over_a_hundred_runs():
    """NEES of the last pose: its mean over 100 runs is chi-square of 300 degrees of freedom, over 100."""
    squared = []
    for k in range(10):  # ten drives, each with the noise of ten: most of the time of a simulation is its plan
        world = build_world("office", 7000 + k)
        poses = cs.simulate(world, n_scans=50, seed=7000 + k).truth.poses
        for seed in range(7000 + 10 * k, 7010 + 10 * k):
            log = cs.simulate(world, poses=poses, seed=seed)
            run = run_engine(log)
            assert StepOutcome.PREDICTED not in run.outcomes
            truth = cs.se2.between(log.truth.poses[0], log.truth.poses[-1])
            error = run.trajectory.poses[-1] - truth
            squared.append(error @ np.linalg.solve(run.trajectory.covariances[-1], error))
    assert 2.54 < np.mean(squared) < 3.50  # 95 % bounds of a mean of 100


def elsewhere(seed):
    """A place like no other: twelve pieces of wall, each at some distance."""
    distances = np.random.default_rng(seed).uniform(1.0, 7.0, 12)
    ranges = np.repeat(distances, 31)[:361]
    return cs.LaserScan(ranges, angle_min=-math.pi / 2, angle_increment=math.pi / 360)


def test_carried_to_an_unseen_place_it_is_lost_and_starts_anew():
    scans, _ = in_the_office(2, 12)
    there, truth = in_the_office(10, 14)
    odometry = cs.Odometry()
    steps = [odometry.add(scan) for scan in [*scans, *there]]
    names = [step.outcome for step in steps]
    assert names[12] is StepOutcome.PREDICTED
    assert names.count(StepOutcome.LOST) == 1
    lost = names.index(StepOutcome.LOST)
    assert 12 < lost <= 12 + KeyframesConfig().max_gap
    # to the past it is open, and stays so; a consumer that chains the motions learns it as well
    for step in steps[lost:]:
        assert np.sqrt(np.diag(step.covariance)[:2]).min() >= 30.0
    assert steps[lost].motion_covariance[0, 0] >= 30.0**2
    # among each other the steps since are sure
    found = cs.se2.between(steps[lost].pose, steps[-1].pose)
    np.testing.assert_allclose(found, cs.se2.between(truth[lost - 12], truth[-1]), atol=0.02)
    assert max(step.motion_covariance[0, 0] for step in steps[lost + 1 :]) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("name", "most"), [("seattle", 0.5), ("belgioioso", 3.5)])
def test_key_scans_as_a_log_are_not_lost(real_data, name, most):
    """A metre apart there is no motion to expect; what the scans say must do."""
    log = cs.read_log(real_data / f"keyframed-corrected/{name}-corrected.log.gz")
    run = run_engine(log)
    assert StepOutcome.LOST not in run.outcomes
    corrected = log.odometry.poses
    end = cs.se2.between(corrected[0], corrected[-1])
    assert np.hypot(*cs.se2.between(end, run.trajectory.poses[-1])[:2]) < most  # of 200 m


def test_a_gap_is_bridged_by_the_first_scan_that_matches_the_one_before_it():
    scans, truth = in_the_office(2, 40)
    odometry = cs.Odometry()
    steps = [odometry.add(scan) for scan in [*scans[:20], elsewhere(1), *scans[21:]]]
    assert steps[20].outcome is StepOutcome.PREDICTED
    assert steps[21].outcome is StepOutcome.RELOCALIZED
    assert StepOutcome.LOST not in [step.outcome for step in steps]
    error = cs.se2.between(cs.se2.between(truth[0], truth[-1]), steps[-1].pose)
    assert np.hypot(*error[:2]) < 0.02
    # nothing is left of the gap in the covariance
    assert np.trace(steps[22].covariance) < 4.0 * np.trace(steps[19].covariance)


def test_the_motions_chain_to_the_poses_where_nothing_leaps():
    scans, _ = in_the_office(4, 30)
    odometry, chained = cs.Odometry(), np.zeros(3)
    for scan in scans:
        step = odometry.add(scan)
        chained = cs.se2.compose(chained, step.motion)
        np.testing.assert_allclose(chained, step.pose, atol=1e-9)
        assert np.linalg.eigvalsh(step.motion_covariance).min() >= 0.0


def test_the_velocity_is_what_makes_the_motion_in_the_time_of_a_scan():
    scans, _ = drive(6)
    odometry = cs.Odometry()
    steps = [odometry.add(scan) for scan in scans]
    np.testing.assert_array_equal(steps[0].velocity, 0.0)
    for step in steps[1:]:
        np.testing.assert_allclose(cs.se2.exp(0.1 * step.velocity), step.motion, atol=1e-9)


def test_stamps_that_jitter_change_nothing():
    scans, _ = in_the_office(5, 30)
    rng = np.random.default_rng(0)
    jittered = [dataclasses.replace(s, stamp=s.stamp + rng.uniform(-1e-3, 1e-3)) for s in scans]
    one, other = run_engine(scans), run_engine(jittered)
    np.testing.assert_array_equal(one.trajectory.poses, other.trajectory.poses)


@pytest.mark.parametrize("jump", [2.0, 5.0, 50.0])
def test_wheels_that_leap_bend_no_sweep(jump):
    sensor = SENSORS["spinning-360"]
    log = cs.simulate(
        "office", sensor=replace(sensor, time_increment=sensor.period / sensor.n_beams), n_scans=30, seed=6
    )
    wheels = log.truth.poses.copy()
    wheels[15:, :2] += jump * np.array([0.6, 0.8])
    odometry = cs.Odometry()
    steps = [odometry.add(scan, pose) for scan, pose in zip(log, wheels, strict=True)]
    assert steps[15].is_prior_rejected
    assert all(step.is_matched for step in steps[1:])
    truth = cs.se2.between(log.truth.poses[0], log.truth.poses)
    assert np.hypot(*(steps[-1].pose - truth[-1])[:2]) < 0.1


@pytest.mark.parametrize(
    "stamps", [(0.0, 5e-324, 1e-12, 3e-12), (-1e308, 1e308, -1e308, 1e308), (0.0, 1e308, 1e308, 0.0)]
)
def test_no_clock_ends_an_odometry(stamps):
    scans, _ = drive(len(stamps))
    odometry = cs.Odometry()
    for scan, stamp in zip(scans, stamps, strict=True):
        assert np.isfinite(odometry.add(replace(scan, stamp=stamp)).pose).all()


@pytest.mark.parametrize(
    ("crept", "n_least", "n_most"),
    [(1e-4, 1, 30), (0.0, 0, 0)],
    ids=["wheels that lag", "wheels that were not updated"],
)
def test_a_match_beats_wheels_that_contradict_it(crept, n_least, n_most):
    """Wheels that hardly move, and then make good for it: left out, counted, and no worse than without.

    Those that stand still to the bit were not updated: they contradict nothing, and what they make good for is known.
    """
    scans, truth = in_the_office(3, 60)
    wheels = truth.copy()
    wheels[30:36] = wheels[30] + crept * np.arange(6)[:, np.newaxis]
    alone, helped = run_engine(scans), run_engine(scans, odometry_poses=wheels)
    assert n_least <= helped.n_prior_rejected <= n_most
    assert alone.n_prior_rejected == 0
    true_end = cs.se2.between(truth[0], truth[-1])
    errors = [np.hypot(*cs.se2.between(true_end, run.trajectory.poses[-1])[:2]) for run in (alone, helped)]
    assert errors[1] < errors[0] + 0.005


@pytest.mark.parametrize("new", [cs.Odometry, cs.Slam])
def test_what_the_wheels_measured_may_come_with_the_scan(new):
    # along a bare corridor the scans leave the way open, and the wheels alone tell it
    log = cs.simulate("bare-corridor", n_scans=60, seed=1)
    way = cs.se2.between(log.truth.poses[0], log.truth.poses)
    apart, together, alone = new(), new(), new()
    for scan, pose in zip(log, way, strict=True):
        known, given = replace(scan, odometry=pose), apart.add(scan, pose)
        step = together.add(known)
        np.testing.assert_array_equal(step.pose, given.pose)
        np.testing.assert_array_equal(step.covariance, given.covariance)
        last = alone.add(scan)
    assert way[-1, 0] > 3.0
    np.testing.assert_allclose(step.pose[:2], way[-1, :2], atol=0.1)
    assert np.trace(last.covariance[:2, :2]) > 10.0 * np.trace(step.covariance[:2, :2])
    if new is cs.Slam:
        assert slam_bits(together) == slam_bits(apart)


def slam_bits(slam):
    slam.finish()
    return slam.trajectory().poses.tobytes(), len(slam.map.ends)


def test_a_run_of_scans_with_wheels_uses_them_where_they_agree():
    log = cs.simulate("office", n_scans=60, seed=1)
    scans = [replace(scan, odometry=pose) for scan, pose in zip(log, log.truth.poses, strict=True)]
    used, left_out = cs.run(scans), cs.run(scans, odometry_prior=False)
    assert used.record.has_prior
    assert not left_out.record.has_prior
    assert left_out.trajectory == cs.run(list(log)).trajectory
    backwards = [replace(scan, odometry=cs.se2.inverse(pose)) for scan, pose in zip(log, log.truth.poses, strict=True)]
    assert not cs.run(backwards).record.has_prior
