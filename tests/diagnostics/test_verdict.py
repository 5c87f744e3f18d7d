"""The verdict: a run that went well is trusted, a wreck is not, and the reasons carry the figures that add up."""

from __future__ import annotations

import math
import shlex

import numpy as np
import pytest

import curvescan as cs
from curvescan.cli.proposals import propose_commands
from curvescan.diagnostics.issues import Issue, Remedy
from curvescan.diagnostics.verdict import judge_run
from curvescan.odometry import StepOutcome, run_odometry
from tests.scenes import room_scan

STALE = Issue(topic="beams", kind="stale_beams", what="30% of the readings are old", remedy=Remedy("drop_stale", True))
FIXED = Issue(topic="beams", kind="fixed_beams", what="beams 0 to 3 are fixed", remedy=Remedy("ignore_beams", (4, 0)))


def drive(n=30):
    return [room_scan((0.05 * k, 0.0, 0.02 * k), sigma=0.003, seed=k) for k in range(n)]


def blank():
    return cs.LaserScan(np.full(361, np.nan), angle_min=-math.pi / 2, angle_increment=math.pi / 360)


def test_a_run_that_went_well_is_trusted():
    verdict = judge_run(run_odometry(drive()))
    assert verdict.is_trusted
    assert verdict.reasons == ()
    assert verdict.sentence.startswith("trusted")


def test_half_of_the_scans_unmatched_is_a_reason_with_its_figures():
    scans = [scan for pair in zip(drive(20), [blank()] * 20, strict=True) for scan in pair]
    run = run_odometry([*scans, blank(), blank()])
    verdict = judge_run(run)
    assert not verdict.is_trusted
    n_failed = int(run.is_failed.sum())
    assert f"{n_failed} of 41 scans are not matched" in verdict.sentence
    assert "3 in a row" in verdict.sentence
    assert verdict.sentence.startswith("not to be trusted: ")


def test_the_reasons_of_unmatched_scans_add_up():
    run = run_odometry([*drive(5), blank(), *drive(3), blank()])
    assert sum(run.failures.values()) + run.n_rejected == run.is_failed.sum()


@pytest.mark.parametrize("n", [0, 1])
def test_a_log_without_a_motion_is_not_trusted(n):
    assert "a motion needs two" in judge_run(run_odometry(drive()[:n])).sentence


@pytest.mark.slow
def test_a_bare_corridor_is_trusted_with_wheels_alone():
    log = cs.simulate("bare-corridor", n_scans=60, seed=5)
    alone = judge_run(run_odometry(log))
    assert "unobservable, which wheel odometry could decide" in alone.sentence
    assert judge_run(run_odometry(log, odometry_poses=log.odometry.poses)).is_trusted


def test_stale_beams_spoil_a_run_and_fixed_ones_do_not():
    run = run_odometry(drive())
    assert STALE.what in judge_run(run, [FIXED, STALE]).reasons
    assert judge_run(run, [FIXED]).is_trusted


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


def test_a_run_on_the_edge_of_the_share_of_unmatched_scans():
    run = run_odometry(drive())
    outcomes = [StepOutcome.MATCHED] * 101
    for n_failed, is_trusted in ((2, True), (3, False)):
        some = [*outcomes[:-n_failed], *[StepOutcome.PREDICTED] * n_failed]
        changed = type(run)(**{**vars(run), "outcomes": tuple(some)})
        assert judge_run(changed).is_trusted is is_trusted
