"""match_many(): the bits of match, each scan prepared once, on one process and on several."""

from __future__ import annotations

import os
import signal
import threading
import time

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers import many
from tests.scenes import room_scan

POSES = np.column_stack((np.linspace(0.0, 0.9, 20), np.linspace(0.0, 0.4, 20), np.linspace(-0.2, 0.3, 20)))


@pytest.fixture(scope="module")
def scans():
    return [room_scan(pose, sigma=0.005, seed=k) for k, pose in enumerate(POSES)]


def bits(result):
    """All that a result holds, but for the trace."""
    poses = [part for one in result.candidates for part in (one.pose, one.log_odds, one.information)]
    arrays = (result.pose, result.covariance, result.information, result.labels_reference, result.labels_current)
    numbers = (result.n_matched, result.score, result.runner_up, result.confidence, result.is_guess_decisive)
    return result.outcome, *(np.asarray(part).tobytes() for part in (*arrays, *poses, *numbers))


def assert_same(found, expected):
    assert [bits(one) for one in found] == [bits(one) for one in expected]


@pytest.mark.parametrize("method", sorted(cs.MATCHERS))
def test_one_reference_gives_the_bits_of_match(method, scans):
    found = cs.match_many(scans[0], scans[:4], method=method)
    expected = [cs.match(scans[0], one, method=method) for one in scans[:4]]
    assert_same(found, expected)
    assert all(one.ok for one in found[:1])
    assert all(one.trace is None for one in found)
    assert all(one.reference is scans[0] and one.current is scan for one, scan in zip(found, scans, strict=False))


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_pairs_with_guesses_give_the_bits_of_match_on_any_number_of_processes(scans, workers):
    guesses = POSES[1:] - POSES[:-1]
    found = cs.match_many(scans[:-1], iter(scans[1:]), guess=guesses, workers=workers)
    expected = [cs.match(a, b, guess=g) for a, b, g in zip(scans, scans[1:], guesses, strict=False)]
    assert_same(found, expected)
    assert sum(one.ok for one in found) > 10
    assert [one.current for one in found] == scans[1:]
    assert all(one.trace is None for one in found)


def test_what_is_known_before_is_one_for_all_or_one_for_each(scans):
    prior = cs.UncertainPose(np.array([0.4, 0.2, 0.0]), 0.05 * np.eye(3))
    for given, each in ((prior, [prior] * 3), ([prior, None, prior], [prior, None, prior])):
        found = cs.match_many(scans[0], scans[:3], prior=given)
        assert_same(found, [cs.match(scans[0], scans[k], prior=one) for k, one in enumerate(each)])
    found = cs.match_many(scans[0], scans[:3], guess=(0.1, 0.0, 0.0))
    assert_same(found, [cs.match(scans[0], one, guess=(0.1, 0.0, 0.0)) for one in scans[:3]])


def test_a_scan_is_prepared_once_and_a_prepared_one_not_again(scans, monkeypatch):
    matcher = cs.prepare(scans[0]).matcher
    ready = cs.prepare(scans[2])
    prepared, prepare = [], type(matcher).prepare
    monkeypatch.setattr(type(matcher), "prepare", lambda self, scan: prepared.append(scan) or prepare(self, scan))
    cs.match_many([scans[0], scans[1], scans[0], ready], [scans[1], scans[0], ready, scans[1]])
    assert [id(one) for one in prepared] == [id(scans[0]), id(scans[1])]


def test_no_candidate_gives_no_result(scans):
    assert cs.match_many(scans[0], []) == []
    assert cs.match_many([], [], workers=2) == []


def test_a_scan_without_readings_is_a_result_with_a_reason(scans):
    blind = cs.LaserScan(np.full(361, np.nan), angle_min=-1.57, angle_increment=0.0087)
    first, second = cs.match_many(scans[0], [blind, scans[0]])
    assert first.outcome is cs.Outcome.NO_SEGMENTS
    assert second.ok


def test_what_a_process_does_not_bring_back_is_matched_here(scans, monkeypatch):
    here = os.getpid()
    matched = many._matched

    def killed(*jobs, **options):
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return matched(*jobs, **options)

    monkeypatch.setattr(many, "_matched", killed)
    found = cs.match_many(scans[0], scans, workers=2)
    assert_same(found, [cs.match(scans[0], one) for one in scans])


def test_a_process_that_waits_for_ever_is_given_up(scans, monkeypatch):
    here, matched = os.getpid(), many._matched

    def stuck(*jobs, **options):
        if os.getpid() != here:
            time.sleep(600.0)
        return matched(*jobs, **options)

    monkeypatch.setattr(many, "_matched", stuck)
    monkeypatch.setattr(many, "_PATIENCE", 0)
    begin = time.monotonic()
    found = cs.match_many(scans[0], scans, workers=2)
    assert time.monotonic() - begin < 60.0
    assert_same(found, [cs.match(scans[0], one) for one in scans])


def test_calls_from_several_threads_do_not_disturb_one_another(scans):
    found = {}

    def ask(k):
        found[k] = cs.match_many(scans[k], scans, workers=1 + k % 2)

    threads = [threading.Thread(target=ask, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for k in range(4):
        assert_same(found[k], [cs.match(scans[k], one) for one in scans])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"candidates": "log.bag"}, "candidates must be several, as"),
        ({"candidates": 3}, "candidates must be several, as a list or a log, got int"),
        ({"candidates": [1.0]}, "candidates must be a LaserScan or a PreparedScan, got float"),
        ({"reference": [None]}, "reference must be one for all 2 candidates or one for each, got 1"),
        ({"reference": None}, "reference must be several, as"),
        ({"guess": np.zeros((3, 3))}, "guess must be one for all 2 candidates or one for each, got 3"),
        ({"guess": [[0, 0, 0], [0, 0, np.nan]]}, r"guess\[1\] must be three finite numbers"),
        ({"guess": (1, 2)}, "guess must be three finite numbers"),
        ({"prior": [None]}, "prior must be one for all 2 candidates or one for each, got 1"),
        ({"prior": [None, 3.0]}, r"prior\[1\] must be an UncertainPose"),
        (
            {"prior": [cs.UncertainPose(np.zeros(3), -np.eye(3))] * 2},
            r"prior\[0\].covariance must be positive definite",
        ),
        ({"workers": 0}, "workers must be a whole number of at least 1, got 0"),
        ({"workers": 1.5}, "workers must be a whole number"),
        ({"method": "orb"}, "unknown method 'orb'"),
    ],
)
def test_a_bad_argument_is_refused_with_its_rule(scans, changes, message):
    arguments = {"reference": scans[0], "candidates": scans[:2]} | changes
    with pytest.raises(cs.InvalidArgumentError, match=message):
        cs.match_many(**arguments)
