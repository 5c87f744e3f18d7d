"""What may be given for a configuration: an instance, a mapping of the fields that differ, or a sentence in return."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.configs import as_config
from tests.scenes import room_scan

MOTION = (0.1, 0.05, 0.1)


def pair():
    return room_scan(sigma=0.005, seed=1), room_scan(MOTION, sigma=0.005, seed=2)


def test_a_mapping_stands_for_the_fields_that_differ():
    given = {"keyframes": {"distance": 1, "max_gap": np.int64(2)}, "deskew": False}
    assert as_config(given, cs.OdometryConfig()) == cs.OdometryConfig(
        keyframes=cs.KeyframesConfig(distance=1.0, max_gap=2), deskew=False
    )
    nested = {"keyframes": cs.KeyframesConfig(distance=0.5)}
    assert as_config(nested, cs.OdometryConfig()).keyframes.distance == 0.5
    default = cs.OdometryConfig()
    assert as_config(None, default) is default
    assert as_config(default, cs.OdometryConfig(deskew=False)) is default


def test_lists_and_tuples_are_taken_for_tuples():
    config = as_config({"quick": [0.1, np.float32(0.5)]}, cs.RefinementConfig())
    assert config.quick == (0.1, 0.5)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"a": 1}, r"config has an unknown key 'a': known are hypotheses, information"),
        ({"scorin": {}}, "unknown key 'scorin': did you mean 'scoring'"),
        ({"segments": {"jum": 1}}, r"config\['segments'\] has an unknown key 'jum': did you mean 'jump'"),
        ({"segments": {"jump": "much"}}, "jump must be of type float, got 'much'"),
        ({"hypotheses": {"max_tried": 3.5}}, "max_tried must be of type int, got 3.5"),
        ({"segments": 3}, r"config\['segments'\] must be a table, got 3"),
        ({"segments": {"arm": -1.0}}, r"config\['segments'\]: arm must be > 0 m, got -1.0"),
        (3, "config must be a CurvescanConfig, a mapping of its fields or None, got int"),
        (cs.CurvescanConfig, "got the class CurvescanConfig"),
        (cs.CfSmaConfig(), "got CfSmaConfig: method 'curvescan' takes no other"),
    ],
)
def test_what_is_wrong_is_said_by_match_and_prepare_alike(given, message):
    a, b = pair()
    with pytest.raises(cs.InvalidArgumentError, match=message):
        cs.match(a, b, config=given)
    with pytest.raises(cs.InvalidArgumentError, match=message):
        cs.prepare(a, config=given)
    with pytest.raises(cs.InvalidArgumentError, match=message.replace("config", "matcher", 1)):
        cs.Odometry(matcher=given)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: cs.SlamConfig(keyframes=cs.KeyframesConfig()),
            "keyframes must be a MapKeyframesConfig, got Keyframes",
        ),
        (
            lambda: cs.OdometryConfig(motion={"sigma_m": 1.0}),
            "motion must be a MotionConfig, got {'sigma_m': 1.0}: give",
        ),
        (lambda: cs.CurvescanConfig(scoring=None), r"used, config={'scoring': {...}}"),
    ],
)
def test_a_part_of_another_configuration_is_refused(make, message):
    with pytest.raises(cs.InvalidArgumentError, match=message):
        make()


def test_a_mapping_does_what_its_instance_does():
    a, b = pair()
    mapping = {"landmarks": {"min_curvature": 3.0}}
    config = cs.CfSmaConfig(landmarks=cs.LandmarksConfig(min_curvature=3.0))
    assert cs.match(a, b, method="cfsma").ok
    assert not cs.match(a, b, method="cfsma", config=config).ok
    assert not cs.match(a, b, method="cfsma", config=mapping).ok
    odometry = cs.Odometry("cfsma", matcher=mapping)
    assert odometry.matcher.config == config
    odometry.add(a)
    assert not odometry.add(b).match.ok


def test_the_configuration_of_an_odometry_is_its_own():
    assert cs.Odometry(config={}).config == cs.OdometryConfig()
    assert cs.Odometry("idc", config={}).config == cs.OdometryConfig.scan_to_scan()
    config = cs.Odometry(config={"motion": {"memory": 10.0}}).config
    assert config == cs.OdometryConfig(motion=cs.MotionConfig(memory=10.0))
    with pytest.raises(cs.InvalidArgumentError, match=r"must be an? OdometryConfig.*given as matcher="):
        cs.Odometry(config=cs.CurvescanConfig())
    with pytest.raises(cs.InvalidArgumentError, match="did you mean 'keyframes'"):
        cs.Odometry(config={"keyframe": {}})
    assert cs.OccupancyBuilder({"resolution": 0.1}).config.resolution == 0.1


@pytest.mark.parametrize("method", cs.MATCHERS)
def test_every_method_takes_an_empty_mapping(method):
    pytest.importorskip("scipy", reason="icp needs SciPy")
    assert cs.Odometry(method, matcher={}).matcher.config == cs.Odometry(method).matcher.config


@pytest.mark.parametrize(
    ("given", "rule"),
    [
        ({"keyframes": {"n_lost": 0}}, "n_lost must be at least 1, got 0"),
        ({"places": {"n_keyframes": 0}}, "n_keyframes must be at least 1, got 0"),
        ({"closures": {"matches_per_scan": -1}}, "matches_per_scan must be at least 1, got -1"),
        ({"keyframes": {"turn": 0.0}}, "turn must be > 0, got 0.0"),
        ({"noise": {"slip": -0.1}}, "slip must be > 0, got -0.1"),
        ({"odometry": {"motion": {"wheel_slip": 0.0}}}, "wheel_slip must be > 0, got 0.0"),
    ],
)
def test_what_slam_counts_is_one_at_least_and_what_it_measures_positive(given, rule):
    with pytest.raises(cs.InvalidArgumentError, match=rule):
        cs.Slam(config=given)
