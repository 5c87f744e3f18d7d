"""The default matcher as a whole: any turn, guesses, ambiguity, corridors, sensors of every kind."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers import DEFAULT_METHOD, Label
from curvescan.matchers.curvescan.config import CurvescanConfig, HypothesesConfig
from curvescan.simulation import simulate_pairs
from tests.matchers.curvescan.scenes import MOTION, hall_scan, pillar_scan, turned
from tests.scenes import room_scan

SUCCESS = (0.1, math.radians(2.0))


def is_right(result, pose):
    error = cs.se2.between(pose, result.pose)
    return bool(result.ok and np.hypot(error[0], error[1]) < SUCCESS[0] and abs(error[2]) < SUCCESS[1])


def test_it_is_the_default():
    assert DEFAULT_METHOD == "curvescan"
    assert cs.match(pillar_scan(), pillar_scan(MOTION, seed=1)).method == "curvescan"


@pytest.mark.parametrize("turn_deg", [0, 30, 60, 90, 120, 150, 180, -75, -135])
def test_any_turn_of_a_full_circle_is_found_without_a_guess(turn_deg):
    pose = np.array([0.2, -0.1, math.radians(turn_deg)])
    for seed in range(3):
        ref = pillar_scan(fov=2 * math.pi, n_beams=360, seed=seed)
        cur = pillar_scan(pose, fov=2 * math.pi, n_beams=360, seed=seed + 10)
        assert is_right(cs.match(ref, cur), pose)


@pytest.mark.parametrize("angle", [0.7, math.pi, -2.0])
def test_the_direction_of_the_sensor_frame_changes_nothing(angle):
    ref, cur = pillar_scan(seed=1), pillar_scan(MOTION, seed=2)
    plain = cs.match(ref, cur)
    result = cs.match(turned(ref, angle), turned(cur, angle))
    turn = np.array([0.0, 0.0, angle])
    expected = cs.se2.compose(cs.se2.compose(turn, plain.pose), cs.se2.inverse(turn))
    # the histograms of directions stand in the sensor frame: the refinement may start from another hypothesis, and
    # ends a fiftieth of a standard deviation away
    np.testing.assert_allclose(result.pose, expected, atol=4e-5)
    np.testing.assert_array_equal(result.labels_current, plain.labels_current)


def test_a_match_repeats_to_the_bit():
    ref, cur = pillar_scan(seed=1), pillar_scan(MOTION, seed=2)
    first, second = cs.match(ref, cur), cs.match(ref, cur)
    np.testing.assert_array_equal(first.pose, second.pose)
    np.testing.assert_array_equal(first.covariance, second.covariance)


@pytest.mark.parametrize("n_beams", [(361, 181), (181, 361), (361, 1081), (90, 361)])
def test_sensors_may_differ_between_the_scans(n_beams):
    ref = pillar_scan(seed=1, n_beams=n_beams[0])
    cur = pillar_scan(MOTION, seed=2, n_beams=n_beams[1])
    result = cs.match(ref, cur)
    assert is_right(result, MOTION)
    assert result.labels_reference.size == n_beams[0]
    assert result.labels_current.size == n_beams[1]


def test_a_full_circle_is_the_same_whichever_beam_is_listed_first():
    """With gaps, where nothing came back, and a resolution of a centimetre: the sensor of a cheap laser."""
    rng, drive = np.random.default_rng(5), cs.simulate("office", sensor="spinning-360", n_scans=12, seed=3)
    scans = [np.where(rng.random(len(s)) < 0.3, np.nan, np.round(s.ranges, 2)) for s in (drive[4], drive[8])]
    step = 2.0 * np.pi / len(drive[0])

    def listed(ranges, first):
        return cs.LaserScan(
            np.roll(ranges, -first), angle_min=-np.pi + first * step, angle_increment=step, range_max=20.0
        )

    found = [cs.match(*(listed(ranges, first) for ranges in scans)) for first in (0, 50, 90, 211)]
    assert found[0].ok
    for other in found[1:]:
        np.testing.assert_allclose(other.pose, found[0].pose, atol=1e-9)
        assert other.confidence == pytest.approx(found[0].confidence, abs=1e-9)


@pytest.mark.parametrize("n_beams", [359, 360, 361])
def test_full_circles_join_at_the_seam_however_many_beams(n_beams):
    step = math.radians(1.0)
    pose = np.array([0.1, 0.1, 2.5])
    scans = [
        pillar_scan(p, fov=step * (n_beams - 1), n_beams=n_beams, seed=k) for k, p in enumerate((np.zeros(3), pose))
    ]
    assert is_right(cs.match(*scans), pose)


def test_a_right_guess_is_used_and_a_wrong_one_loses():
    ref, cur = cs.prepare(pillar_scan(seed=1)), cs.prepare(pillar_scan(MOTION, seed=2))
    plain = cs.match(ref, cur)
    guided = cs.match(ref, cur, guess=MOTION + 0.02)
    assert guided.trace.candidates.n_tried == 1
    np.testing.assert_allclose(guided.pose, plain.pose, atol=2e-4)
    around = cs.match(ref, cur, guess=np.add(MOTION, [0.02, 0.02, 0.02 + 2.0 * math.pi]))
    assert -math.pi < around.trace.candidates.poses[0, 2] <= math.pi  # an angle as any other
    np.testing.assert_allclose(around.pose, guided.pose, atol=1e-9)
    rng = np.random.default_rng(0)
    for _ in range(20):
        guess = rng.uniform([-3, -3, -math.pi], [3, 3, math.pi])
        assert is_right(cs.match(ref, cur, guess=guess), MOTION)


def test_a_symmetric_room_is_ambiguous_until_a_guess_decides():
    def scan(pose, seed):
        return room_scan(pose, sigma=0.005, seed=seed, n_beams=360, fov=2 * math.pi * 359 / 360)

    room_centre = np.array([0.5, 0.5, 0.0])  # where a half turn shows the same
    ref, cur = scan(room_centre, 1), scan(room_centre + np.array([0.1, 0.05, 0.05]), 2)
    result = cs.match(ref, cur)
    assert result.outcome is cs.Outcome.AMBIGUOUS
    assert np.isnan(result.pose).all()
    assert result.runner_up > 0.9 * result.score
    truth = np.array([0.1, 0.05, 0.05])
    assert is_right(cs.match(ref, cur, guess=[0.0, 0.0, 0.0]), truth)
    flipped = cs.match(ref, cur, guess=[0.0, 0.0, math.pi])
    assert flipped.ok
    assert abs(abs(flipped.pose[2]) - math.pi) < 0.2


def test_a_corridor_names_its_weak_direction():
    for seed in range(5):
        result = cs.match(hall_scan(0.0, seed=2 * seed), hall_scan(0.3, seed=2 * seed + 1))
        assert result.ok
        weak = result.degenerate_direction
        assert abs(weak[0]) > 0.95 * np.hypot(weak[0], weak[1])
        assert math.sqrt(result.covariance[0, 0]) > 0.5
        # across and in angle the corridor tells
        assert abs(result.pose[1]) < 0.02
        assert abs(result.pose[2]) < 0.01
        assert np.abs(result.information @ weak).max() < 1e-6 * np.abs(result.information).max()
        assert result.information[1, 1] > 1e4  # 1 cm
    rich = cs.match(pillar_scan(seed=1), pillar_scan(MOTION, seed=2))
    assert rich.degenerate_direction is None
    assert math.sqrt(np.diag(rich.covariance).max()) < 0.005


def test_places_with_nothing_in_common_give_no_pose():
    rng = np.random.default_rng(0)
    n_ok = 0
    for _ in range(100):
        clutter = cs.LaserScan(rng.uniform(1.0, 7.0, 361), angle_min=-math.pi / 2, angle_increment=math.pi / 360)
        result = cs.match(pillar_scan(), clutter)
        n_ok += result.ok
        if not result.ok:
            assert result.outcome in (cs.Outcome.UNSUPPORTED, cs.Outcome.AMBIGUOUS, cs.Outcome.NO_SEGMENTS)
            assert np.isnan(result.covariance).all()
            assert (result.labels_current <= Label.UNMATCHED).all()
    assert n_ok == 0


def test_readings_are_told_what_they_are():
    ref, scan = pillar_scan(seed=1), pillar_scan(MOTION, seed=2)
    ranges = scan.ranges.copy()
    ranges[50:60] = np.nan
    ranges[100:110] = 0.6
    cur = cs.LaserScan(ranges, angle_min=scan.angle_min, angle_increment=scan.angle_increment, range_max=20.0)
    result = cs.match(ref, cur)
    assert (result.labels_current[50:60] == Label.NO_READING).all()
    assert (result.labels_current[100:110] == Label.DYNAMIC).all()
    assert np.mean(result.labels_current == Label.MATCHED) > 0.8
    assert result.n_matched == np.count_nonzero(result.labels_current == Label.MATCHED)


def test_the_configuration_is_used():
    blind = CurvescanConfig(hypotheses=HypothesesConfig(max_tried=1, n_rotations=1))
    ref, cur = pillar_scan(seed=1), pillar_scan(MOTION, seed=2)
    assert cs.match(ref, cur, config=blind).trace.candidates.n_tried < 5
    with pytest.raises(cs.InvalidArgumentError, match="must be a CurvescanConfig"):
        cs.match(ref, cur, config=HypothesesConfig())


@pytest.mark.slow
@pytest.mark.parametrize("sensor", ["sick-lms200", "spinning-360", "hokuyo-270"])
@pytest.mark.parametrize(
    ("translation", "rotation_deg", "people", "least"),
    # shares of pairs in the middle of what was measured over 300, less three standard errors of 60
    [(0.1, 5.0, 0.0, 0.98), (0.6, 40.0, 0.0, 0.98), (0.6, 40.0, 0.15, 0.93)],
)
def test_offices_are_matched_without_a_guess(sensor, translation, rotation_deg, people, least):
    pairs = simulate_pairs(
        "office",
        sensor=sensor,
        n_pairs=60,
        translation_max=translation,
        rotation_max=math.radians(rotation_deg),
        people_share=people,
        seed=11,
    )
    results = [(cs.match(p.reference, p.current), p.pose) for p in pairs]
    right = [(r, pose) for r, pose in results if is_right(r, pose)]
    assert len(right) >= least * 60
    # confidently wrong: none
    assert sum(r.ok and r.degenerate_direction is None for r, _ in results) == sum(
        r.degenerate_direction is None for r, _ in right
    )
    errors = [r.pose - pose for r, pose in right]
    nees = [e @ np.linalg.solve(r.covariance, e) for e, (r, _) in zip(errors, right, strict=True)]
    assert 1.8 < np.mean(nees) < 4.2
    assert np.median(np.hypot(*np.array(errors)[:, :2].T)) < 0.003


@pytest.mark.slow
def test_key_scans_of_a_castle_are_matched_without_a_guess(real_data):
    path = real_data / "keyframed-corrected" / "belgioioso-corrected.log.gz"
    if not path.exists():
        pytest.skip(f"{path} is not there")
    log = cs.read_log(path)
    prepared = [cs.prepare(scan) for scan in log]
    poses = log.odometry.poses
    right = 0
    for a, b, pose_a, pose_b in zip(prepared, prepared[1:], poses, poses[1:], strict=False):
        result = cs.match(a, b)
        if result.ok:
            error = cs.se2.between(cs.se2.between(pose_a, pose_b), result.pose)
            right += np.hypot(*error[:2]) < 0.25 and abs(error[2]) < math.radians(3.0)
    # the corrected poses are the output of a SLAM system, not the truth
    assert right >= 0.97 * (len(prepared) - 1)
