"""The sense of rotation: known turns of a simulated sensor, mirrored ones, and what tells nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from curvescan import LaserScan, simulate
from curvescan.diagnostics.rotation_direction import compare_rotation, rotation_of_log, turn_between
from curvescan.scan import mirrored
from curvescan.simulation.buildings.rooms import room
from curvescan.simulation.sensing.raycast import cast_rays

STEP = math.radians(1.0)
WORLD = room()


def look(theta, *, n=360, step=STEP, angle_min=-math.pi, range_max=30.0):
    ranges, _ = cast_rays(WORLD, (0.4, -0.3, theta), angle_min=angle_min, angle_increment=step, n_beams=n)
    return LaserScan(ranges, angle_min=angle_min, angle_increment=step, range_max=range_max)


@pytest.mark.parametrize("turn_deg", [-30.0, -3.0, 4.0, 25.0])
@pytest.mark.parametrize("n", [360, 270])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_turn_is_found_whatever_way_the_beams_run(turn_deg, n, sign):
    beams = {"n": n, "step": sign * math.radians(1.0), "angle_min": -sign * math.radians(n / 2)}
    turn = turn_between(look(0.2, **beams), look(0.2 + math.radians(turn_deg), **beams))
    # the sensor turns on the spot by whole steps: nothing but the seam's rounding is left
    assert math.degrees(turn) == pytest.approx(turn_deg, abs=1e-6)


def test_mirrored_scans_turn_the_other_way():
    one, two = look(0.0), look(math.radians(6.0))
    assert turn_between(mirrored(one), mirrored(two)) == pytest.approx(-turn_between(one, two))


def test_what_does_not_tell_is_zero():
    scan = look(0.0)
    assert turn_between(scan, scan) == 0.0
    assert turn_between(scan, look(0.0, n=300)) == 0.0
    blank = replace(scan, ranges=np.full(360, np.nan))
    assert turn_between(blank, blank) == 0.0
    circle = replace(scan, ranges=np.full(360, 3.0))
    assert turn_between(circle, circle) == 0.0
    empty = LaserScan([], angle_min=0.0, angle_increment=0.1)
    assert turn_between(empty, empty) == 0.0


def drive(n=30, seed=0):
    turns = np.random.default_rng(seed).choice([-8.0, -3.0, 3.0, 8.0], n)
    headings = np.radians(np.cumsum(turns))
    return [look(theta) for theta in headings], headings


def test_scans_turn_with_the_robot_or_against_it():
    scans, headings = drive()
    along = compare_rotation(scans, headings, "wheel odometry")
    assert (along.is_along, along.is_reversed, along.n_reversed) == (True, False, 0)
    assert along.n_turns == 29
    assert along.ratio == pytest.approx(1.0, abs=0.01)
    against = compare_rotation(map(mirrored, scans), headings, "wheel odometry")
    assert (against.is_along, against.is_reversed, against.n_reversed) == (False, True, 29)
    degrees = compare_rotation(scans, np.degrees(headings), "gyroscope")
    assert degrees.is_along
    assert degrees.ratio == pytest.approx(180.0 / math.pi, rel=0.01)


def test_few_or_contradicting_turns_decide_nothing():
    scans, headings = drive(n=9)
    sense = compare_rotation(scans, headings, "wheel odometry")
    assert (sense.n_turns, sense.is_along, sense.is_reversed) == (8, False, False)
    scans, _ = drive(n=60)
    strange = np.radians(np.cumsum(np.random.default_rng(8).choice([-5.0, 5.0], 60)))
    sense = compare_rotation(scans, strange, "wheel odometry")
    assert (sense.is_along, sense.is_reversed) == (False, False)


def test_a_reference_that_never_turns_or_is_not_known_tells_nothing():
    scans, headings = drive(n=5)
    assert compare_rotation(scans, np.zeros(5), "wheel odometry") is None
    assert compare_rotation(scans, np.full(5, np.nan), "wheel odometry") is None
    gaps = np.where(np.arange(5) == 2, np.nan, headings)
    assert compare_rotation(scans, gaps, "wheel odometry").n_turns == 2
    assert compare_rotation([], np.empty(0), "gyroscope") is None


def test_a_simulated_drive_turns_with_its_wheels():
    log = simulate("office-floor", n_scans=150, seed=2)
    assert rotation_of_log(log).is_along
