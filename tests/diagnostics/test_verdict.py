"""The verdict: each reason stands on its figures, on either side of its bound, and says what helps."""

from __future__ import annotations

import shlex
from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.cli.flags import propose_commands
from curvescan.diagnostics.issues import Issue, Remedy
from curvescan.diagnostics.verdict import Evidence, judge, verdict_of
from curvescan.odometry import run_odometry
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
    assert "a motion needs two" in judge(run_odometry(scans, odometry), odometry).sentence


@pytest.mark.parametrize(
    ("engine", "n_failed", "is_trusted"),
    [("odometry", 2, True), ("odometry", 3, False), ("slam", 20, True), ("slam", 21, False)],
)
def test_scans_without_a_match_count_by_what_bridges_them(engine, n_failed, is_trusted):
    verdict = verdict_of(evidence(engine=engine, n_failed=n_failed))
    assert verdict.is_trusted is is_trusted
    if not is_trusted:
        assert f"{n_failed} of 100 scans are not matched ({n_failed}%), up to {n_failed} in a row" in verdict.sentence


def test_parts_of_the_map_count_and_not_what_was_lost_on_the_way():
    assert "the map is in 2 parts" in reason(engine="slam", n_parts=2, sigma=1000.0)
    assert "uncertain" not in reason(engine="slam", n_parts=2, sigma=1000.0)
    assert "the trajectory is in 3 parts" in reason(n_parts=3)


@pytest.mark.parametrize(
    ("engine", "path", "most"), [("odometry", 10.0, 0.5), ("odometry", 100.0, 2.0), ("slam", 200.0, 2.0)]
)
def test_the_final_uncertainty_counts_by_the_path(engine, path, most):
    assert verdict_of(evidence(engine=engine, path=path, sigma=0.99 * most)).is_trusted
    assert "uncertain by up to" in reason(engine=engine, path=path, sigma=1.01 * most)


def test_matches_that_contradict_the_map_are_told_with_their_place():
    said = reason(engine="slam", contradictions=((7, 4, 12.2, -3.4), (3, 3, 0.0, 0.0)))
    assert "10 sure matches from 7 keyframes contradict the map, most at x 12 m, y -3 m" in said


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
    figures = {"n_parts": 2, "is_cut": True, "n_failed": 50, "is_aliased": True, "contradictions": ((3, 3, 0.0, 0.0),)}
    for one in verdict_of(evidence(engine="slam", **figures)).reasons:
        assert "what helps: " in one


@pytest.mark.slow
def test_a_bare_corridor_is_trusted_with_wheels_alone():
    log = cs.simulate("bare-corridor", n_scans=60, seed=5)
    alone = cs.run(log, odometry_prior=False).verdict
    assert "unobservable; what helps: the log's wheels" in alone.sentence
    assert cs.run(log, odometry_prior=True).verdict.is_trusted


@pytest.mark.parametrize(("share", "is_trusted"), [(0.3, True), (0.31, False)])
def test_a_drive_that_is_open_for_a_third_is_not_trusted_without_wheels(share, is_trusted):
    is_open = np.arange(100) < 100 * share
    for engine in ("odometry", "slam"):
        figures = {"n": 100, "is_open": is_open, "engine": engine}
        assert verdict_of(evidence(**figures)).is_trusted == is_trusted
        assert verdict_of(evidence(**figures, motion="used")).is_trusted
    if not is_trusted:
        assert "in 31% of the scans motion along one direction is unobservable" in reason(n=100, is_open=is_open)


def test_faults_that_spoil_readings_are_reasons_and_others_are_not():
    assert STALE.what in reason(faults=(STALE.what,))
    log = cs.simulate("office", n_scans=5, seed=1)
    run = cs.run(log)
    assert run.verdict.is_trusted
    spoilt = replace(run.prepared, mended=replace(run.prepared.mended, issues=(STALE, FIXED)))
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
