"""The verdict: each reason stands on its figures, on either side of its bound, and says what helps."""

from __future__ import annotations

import math
import re
import shlex
import tomllib
from dataclasses import replace
from importlib.resources import files
from types import SimpleNamespace

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.cli.console import propose_commands
from curvescan.diagnostics.breaks import Break, find_ambiguous, find_torn
from curvescan.diagnostics.issues import Issue, Remedy
from curvescan.diagnostics.verdict import MAX_OPEN_SHARE, Evidence, judge, largest_sigma, verdict_of
from curvescan.editing.operations import part_of
from curvescan.engines import run_engine
from curvescan.io.arrays.memory import MemoryLog
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.matchers import find_matcher
from curvescan.slam import Slam
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph
from tests.conftest import ROOT
from tests.scenes import room_scan

STALE = Issue(topic="beams", kind="stale_beams", what="30% of the readings are old", remedy=Remedy("drop_stale", True))
FIXED = Issue(topic="beams", kind="fixed_beams", what="beams 0 to 3 are fixed", remedy=Remedy("ignore_beams", (4, 0)))


def evidence(n=101, n_failed=0, **figures):
    known = np.ones(n, dtype=bool)
    failed = np.arange(n) > n - 1 - n_failed
    return Evidence(
        **{
            "n_scans": n,
            "is_unmatched": failed,
            "is_open": np.zeros(n, dtype=bool),
            "is_known": known,
            "path": 30.0,
            "sigma": 0.03,
            **figures,
        }
    )


def reason(**figures):
    return verdict_of(evidence(**figures)).sentence


def test_a_result_that_nothing_speaks_against_is_trusted():
    for engine in ("odometry", "slam", "localization"):
        verdict = verdict_of(evidence(engine=engine))
        assert verdict.is_trusted
        assert verdict.reasons == ()
        assert verdict.sentence.startswith("trusted")


@pytest.mark.parametrize("n", [0, 1])
def test_a_log_without_a_motion_is_not_trusted(n):
    scans = [room_scan((0.0, 0.0, 0.0)) for _ in range(n)]
    odometry = cs.Odometry()
    assert "a motion needs two" in judge(run_engine(scans, odometry), odometry).sentence


@pytest.mark.parametrize(
    ("engine", "n_failed", "is_trusted"),
    [("odometry", 2, True), ("odometry", 3, False), ("slam", 20, True), ("slam", 21, False)],
)
def test_scans_without_a_match_count_by_what_bridges_them(engine, n_failed, is_trusted):
    verdict = verdict_of(evidence(engine=engine, n_failed=n_failed))
    assert verdict.is_trusted is is_trusted
    if not is_trusted:
        assert f"{n_failed} of 100 scans are not matched ({n_failed}%), up to {n_failed} in a row" in verdict.sentence


def test_scans_that_wheels_bridge_count_by_their_covariance():
    assert verdict_of(evidence(engine="slam", n_failed=50, motion="used")).is_trusted
    assert "51 of 100 scans are not matched" in reason(engine="slam", n_failed=51, motion="used")
    assert "uncertain by up to 0.6 m" in reason(engine="slam", n_failed=50, motion="used", sigma=0.6)


def test_parts_of_the_map_count_and_not_what_was_lost_on_the_way():
    assert "the map is in 2 parts" in reason(engine="slam", n_parts=2, sigma=1000.0)
    assert "uncertain" not in reason(engine="slam", n_parts=2, sigma=1000.0)
    assert "the trajectory is in 3 parts" in reason(n_parts=3)


@pytest.mark.parametrize(
    ("engine", "path", "extent", "most"),
    [
        ("odometry", 10.0, 5.0, 0.5),
        ("odometry", 100.0, 5.0, 2.0),
        ("slam", 900.0, 20.0, 0.5),
        ("slam", 900.0, 80.0, 1.0),
    ],
)
def test_an_odometry_is_judged_by_its_path_and_a_map_by_its_size(engine, path, extent, most):
    figures = {"engine": engine, "path": path, "extent": extent}
    assert verdict_of(evidence(**figures, sigma=0.99 * most)).is_trusted
    assert "uncertain by up to" in reason(**figures, sigma=1.01 * most)


def test_matches_that_contradict_the_map_are_told_with_their_place():
    said = reason(engine="slam", contradictions=((7, 4, 12.2, -3.4), (3, 3, 0.0, 0.0)))
    assert "10 matches from 7 keyframes contradict the map, most at x 12 m, y -3 m" in said


@pytest.mark.parametrize(("n_known", "is_trusted"), [(95, True), (70, False), (0, False)])
def test_localization_says_in_how_many_scans_the_sensor_was_found(n_known, is_trusted):
    known = np.arange(100) >= 100 - n_known
    verdict = verdict_of(evidence(n=100, engine="localization", is_known=known))
    assert verdict.is_trusted is is_trusted
    assert is_trusted or ("in 70% of the scans, first in scan 30" if n_known else "not found") in verdict.sentence


def test_a_log_that_was_cut_short_says_how_much_is_missing():
    assert "19 of about 510 scans are there" in reason(n=19, is_cut=True, n_recorded=510)
    assert "its end is missing" in reason(is_cut=True)
    assert verdict_of(evidence(n_recorded=510)).is_trusted


def test_each_reason_names_what_helps_and_wheels_where_there_are_some():
    assert "odometry_prior=True" in reason(n_parts=2, motion="left out")
    assert "a log with wheel odometry" in reason(n_parts=2, motion="none")
    assert "odometry" not in reason(n_parts=2, motion="used", engine="slam")
    figures = {"n_parts": 2, "is_cut": True, "n_failed": 50, "contradictions": ((3, 3, 0.0, 0.0),)}
    for one in verdict_of(evidence(engine="slam", **figures)).reasons:
        assert "what helps: " in one


@pytest.mark.slow
def test_a_bare_corridor_is_trusted_with_wheels_alone():
    log = cs.simulate("bare-corridor", n_scans=60, seed=5)
    alone = cs.run(log, odometry_prior=False).verdict
    assert "unobservable; what helps: the log's wheels" in alone.sentence
    assert cs.run(log, odometry_prior=True).verdict.is_trusted


@pytest.mark.parametrize(
    ("engine", "share", "is_trusted"),
    [("odometry", 0.3, True), ("odometry", 0.31, False), ("slam", 0.9, True), ("slam", 0.91, False)],
)
def test_a_drive_that_leaves_the_motion_open_is_not_trusted_without_wheels(engine, share, is_trusted):
    figures = {"n": 100, "is_open": np.arange(100) < 100 * share, "engine": engine}
    assert verdict_of(evidence(**figures)).is_trusted == is_trusted
    assert verdict_of(evidence(**figures, motion="used")).is_trusted
    if not is_trusted:
        assert f"in {share:.0%} of the scans motion along one direction is unobservable" in reason(**figures)


@pytest.mark.slow
def test_a_start_that_little_ties_does_not_make_a_map_uncertain():
    """A robot that stands in a bare corridor first may have been a metre along it."""
    engine = Slam()
    for scan in cs.simulate("office", n_scans=300, seed=2):
        engine.add(scan)
    trajectory = engine.finish()
    assert engine.graph.n_poses > 52
    for row in np.flatnonzero((engine.graph.ends == 0).any(axis=1)).tolist():
        engine.graph.edge_covariances[row] += np.diag([1.0, 1.0, 0.0])
    assert engine.map.covariances[-1, 0, 0] > 0.3
    record = SimpleNamespace(trajectory=trajectory)
    assert largest_sigma(record, engine) < 0.05


def spoilt(log, *, frozen=range(0), other=None, slip=None, noise=0.005):
    """A drive with wheels whose scans freeze or are of another place, or whose wheels slip."""
    rng, scans, odometry = np.random.default_rng(0), [], log.odometry
    for i, scan in enumerate(log):
        ranges = scan.ranges
        if i in frozen:
            ranges = log[frozen[0]].ranges + noise * rng.standard_normal(len(scan))
        if other is not None and i >= len(log) - len(other):
            ranges = other[i - len(log) + len(other)].ranges
        scans.append(replace(scan, ranges=ranges))
    if slip is not None:  # the robot stands for 40 scans more, and its wheels turn
        stands, metres = slip
        stamps = np.arange(len(log) + 40) * (scans[1].stamp - scans[0].stamp)
        there = scans[stands]
        held = [replace(there, ranges=there.ranges + 0.01 * rng.standard_normal(len(there.ranges))) for _ in range(40)]
        scans = [*scans[:stands], *held, *scans[stands:]]
        scans = [replace(scan, stamp=stamp) for scan, stamp in zip(scans, stamps, strict=True)]
        spun = np.linspace(0.0, metres, 40)[:, np.newaxis] * [1.0, 0.0, 0.0]
        poses = odometry.poses
        turning = se2.compose(poses[stands], spun)
        after = se2.compose(turning[-1], se2.between(poses[stands], poses[stands:]))
        odometry = Trajectory(stamps=stamps, poses=np.concatenate([poses[:stands], turning, after]))
    return MemoryLog(scans=tuple(scans), odometry=odometry, name="spoilt")


@pytest.fixture(scope="module")
def hall():
    return cs.simulate("l-hall", sensor="spinning-360", n_scans=200, seed=3)


def verdict_on(log):
    return cs.run(log, "slam", odometry_prior=True, keeps_steps=False).verdict


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_a_scanner_that_repeats_a_scan_while_the_wheels_drive_is_told(hall, noise):
    verdict = verdict_on(spoilt(hall, frozen=range(80, 120), noise=noise))
    assert "show a sensor that stands, while the wheels drive" in verdict.sentence


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "frozen"), [(143, range(144, 204)), (263, range(139, 198))])
def test_a_frozen_scanner_is_told_by_an_open_direction_or_a_short_leap_at_its_end(seed, frozen):
    log = cs.simulate("room", sensor="urg-04lx", n_scans=300, seed=seed, n_people=3)
    sentence = verdict_on(spoilt(log, frozen=frozen, noise=0.005)).sentence
    assert "show a sensor that stands, while the wheels drive" in sentence


@pytest.mark.slow
def test_parts_that_wheels_alone_tie_are_told_where_the_scans_should_match(hall):
    other = cs.simulate("clutter", sensor="spinning-360", n_scans=100, seed=7)
    assert "wheels alone say how the parts" in verdict_on(spoilt(hall, other=other)).sentence


@pytest.mark.slow
@pytest.mark.parametrize("spoil", [{}, {"slip": (100, 2.0)}])
def test_wheels_that_slip_are_no_break(hall, spoil):
    verdict = verdict_on(spoilt(hall, **spoil))
    assert verdict.is_trusted, verdict.sentence


@pytest.mark.slow
def test_a_frozen_scanner_without_wheels_is_told_by_the_leap_at_its_end():
    log = cs.simulate("t-hall", sensor="hokuyo-270", n_scans=300, seed=68)
    frozen = spoilt(log, frozen=range(112, 172))
    verdict = cs.run(replace(frozen, odometry=None), "slam", keeps_steps=False).verdict
    assert not verdict.is_trusted
    assert cs.run(replace(spoilt(log), odometry=None), "slam", keeps_steps=False).verdict.is_trusted


@pytest.mark.slow
def test_a_sensor_that_was_blind_is_not_frozen():
    log = cs.simulate("office", sensor="spinning-360", n_scans=120, seed=5, odometry_noise=None)
    blind = [replace(scan, ranges=np.full(len(scan), np.inf)) if 60 <= k < 74 else scan for k, scan in enumerate(log)]
    verdict = cs.run(blind, "slam", keeps_steps=False).verdict
    assert verdict.is_trusted, verdict.sentence


LOST_AT = 60


def _ambiguous(record, slam_map):
    """Breaks of a map, whose keyframes are made of its scans."""
    keyframes = Keyframes(find_matcher("curvescan"))
    keyframes.add_all(slam_map)
    return find_ambiguous(record, slam_map, keyframes)


@pytest.fixture(scope="module")
def map_and_record(hall):
    """The map of a drive that never was lost, and a record that has it lost in its middle."""
    engine = Slam()
    for scan in hall:
        engine.add(scan)
    engine.finish()
    outcomes = [cs.StepOutcome.MATCHED] * len(hall)
    outcomes[LOST_AT] = cs.StepOutcome.LOST
    stamps, sure = 0.1 * np.arange(len(hall)), np.full(len(hall), 0.99)
    record = {"trajectory": SimpleNamespace(stamps=stamps), "scan_period": 0.1, "confidence": sure, "has_prior": False}
    return engine.map, SimpleNamespace(outcomes=tuple(outcomes), **record)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("off", "is_told"), [((0.0, 0.0, 0.0), False), ((3.0, 0.0, 0.0), True), ((0.0, 0.0, 1.5), True)]
)
def test_a_lost_track_must_tell_the_place_where_it_was_joined(map_and_record, off, is_told):
    slam_map, record = map_and_record
    since = (slam_map.indices >= LOST_AT)[:, np.newaxis]
    moved = replace(slam_map, poses=np.where(since, se2.compose(off, slam_map.poses), slam_map.poses))
    assert [b.first for b in _ambiguous(record, moved)] == [LOST_AT] * is_told


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seconds", "confidence", "has_prior", "is_told"),
    [
        (2.0, 0.8, False, True),
        (2.0, math.nan, False, True),
        (2.0, 0.95, False, False),
        (0.5, 0.8, False, False),
        (2.0, 0.8, True, False),
    ],
)
def test_where_scans_are_missing_a_match_in_doubt_must_tell_its_place(
    map_and_record, seconds, confidence, has_prior, is_told
):
    slam_map, lost = map_and_record
    stamps, said = lost.trajectory.stamps.copy(), lost.confidence.copy()
    stamps[LOST_AT:] += seconds
    said[LOST_AT] = confidence
    record = SimpleNamespace(
        outcomes=(cs.StepOutcome.MATCHED,) * len(said),
        trajectory=SimpleNamespace(stamps=stamps),
        scan_period=0.1,
        confidence=said,
        has_prior=has_prior,
    )
    since = (slam_map.indices >= LOST_AT)[:, np.newaxis]
    moved = replace(slam_map, poses=np.where(since, se2.compose((0.0, 0.0, 1.5), slam_map.poses), slam_map.poses))
    assert [b.first for b in _ambiguous(record, moved)] == [LOST_AT] * is_told
    assert _ambiguous(record, slam_map) == []


@pytest.mark.slow
@pytest.mark.parametrize(("n_keyframes", "is_told"), [(9, False), (10, True)])
def test_a_track_that_tells_no_place_is_told_where_it_is_long(map_and_record, n_keyframes, is_told):
    slam_map, record = map_and_record
    other = list(cs.simulate("clutter", sensor="spinning-360", n_scans=100, seed=7))
    since = np.flatnonzero(slam_map.indices >= LOST_AT)
    scans = list(slam_map.scans)
    for n, row in enumerate(since.tolist()):
        scans[row] = other[8 * n % len(other)]
    there = part_of(replace(slam_map, scans=tuple(scans)), np.arange(since[0] + n_keyframes))
    assert bool(_ambiguous(record, there)) is is_told


@pytest.mark.parametrize(("kind", "has_wheels", "is_told"), [(0, False, True), (1, False, False), (1, True, True)])
def test_a_measured_step_that_the_loops_refuse_is_a_tear(kind, has_wheels, is_told):
    graph = PoseGraph()
    for x in (0.0, 1.0, 4.0):
        graph.add_pose(np.array([x, 0.0, 0.0]))
    ahead, cov = np.array([1.0, 0.0, 0.0]), 1e-4 * np.eye(3)
    graph.add_edge(0, 1, ahead, cov, EdgeKind.MATCH)
    graph.add_edge(1, 2, ahead, cov, EdgeKind(kind), weight=1e-4)
    keyframes = [SimpleNamespace(index=5 * k, session=1) for k in range(3)]
    engine = SimpleNamespace(graph=graph, keyframes=keyframes)
    assert find_torn(engine, 2.1, has_wheels=has_wheels) == []
    torn = find_torn(engine, 1.9, has_wheels=has_wheels)
    assert [(b.first, b.last) for b in torn] == [(5, 10)] * is_told
    if torn:
        assert "between scans 5 and 10 the map is torn by 2.0 m" in reason(engine="slam", breaks=tuple(torn))
    keyframes[1].session = 0  # a step of the map that is continued is none of this log
    assert find_torn(engine, 1.9, has_wheels=has_wheels) == []


def test_the_guide_has_a_row_for_each_reason():
    guide = (ROOT / "docs" / "howto" / "verdict.md").read_text("utf-8")
    rows = re.findall(
        r"^\* - (.+)$", guide[guide.index("Reasons not to trust") : guide.index("(outcomes)=")], re.MULTILINE
    )
    reasons = tomllib.loads((files("curvescan.diagnostics") / "verdict.toml").read_text("utf-8"))
    assert len(rows) == 1 + len(reasons)
    for said, reason_of in zip(rows[1:], reasons.values(), strict=True):
        assert said in reason_of["what"]


def test_a_lost_track_that_is_joined_in_a_place_like_others_is_a_reason():
    said = reason(engine="slam", breaks=(Break("ambiguous", 100, 100, 0.0),))
    assert "after scan 100, where the track was lost or scans are missing, matches have joined it in a place" in said
    assert "what helps: a log with wheel odometry; or drive from one part to the other once more" in said


@pytest.mark.slow
def test_slam_in_a_corridor_is_judged_by_what_its_closures_leave():
    curved = cs.simulate("curved-hall", sensor="urg-04lx", n_scans=300, seed=70)
    alone = cs.run(curved, "slam", odometry_prior=False)
    assert alone.record.is_degenerate.mean() > MAX_OPEN_SHARE
    assert alone.verdict.is_trusted, alone.verdict.sentence
    bare = cs.simulate("bare-corridor", sensor="urg-04lx", n_scans=150, seed=0)
    assert "unobservable" in cs.run(bare, "slam", odometry_prior=False).verdict.sentence


def test_faults_that_spoil_readings_are_reasons_and_others_are_not():
    assert STALE.what in reason(faults=(STALE.what,))
    log = cs.simulate("office", n_scans=5, seed=1)
    run = cs.run(log)
    assert run.verdict.is_trusted
    spoilt = replace(run.prepared, issues=(STALE, FIXED))
    verdict = judge(run.record, run.engine, spoilt)
    assert verdict.reasons == (f"{STALE.what}; what helps: drop_stale=True",)


def test_one_command_takes_every_option():
    command = ["curvescan", "odometry", "my log.clf", "--out", "o"]
    (sentence,) = propose_commands(command, [STALE, FIXED])
    assert shlex.split(sentence.partition("try: ")[2]) == [*command, "--drop-stale", "--ignore-beams", "4", "0"]
    assert propose_commands(command, []) == ()


def test_a_flag_that_turned_the_beams_the_wrong_way_round_is_left_out():
    command = ["curvescan", "slam", "a.bag", "--backwards", "--out", "o"]
    wrong = Issue(topic="beams", kind="beams_reversed", what="reversed", remedy=Remedy("backwards", True))
    (sentence,) = propose_commands(command, [wrong, STALE])
    assert sentence.endswith("; try: curvescan slam a.bag --out o --drop-stale")
