"""repr of every public object: one line that says what it is."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.simulation import simulate_pairs
from curvescan.slam.loops.closures import Closure, ClosureOutcome
from tests.scenes import room_scan


@pytest.fixture(scope="module")
def objects():
    simulated = cs.simulate("office", n_scans=6, seed=1)
    run = cs.run(simulated)
    scan = room_scan(sigma=0.005, seed=1)
    builder = cs.OccupancyBuilder()
    builder.add(scan, (0.0, 0.0, 0.0))
    odometry = cs.Odometry()
    step = odometry.add(scan)
    (pair,) = simulate_pairs(n_pairs=1, seed=0)
    return {
        "scan": (scan, "LaserScan("),
        "prepared": (cs.prepare(scan), "PreparedScan(LaserScan("),
        "match": (cs.match(scan, scan), "MatchResult(curvescan: x="),
        "candidate": (cs.match(scan, scan).candidates[0], "Candidate(x=0.000 m"),
        "uncertain": (
            cs.UncertainPose((1.0, 2.0, 0.5), [[0.01, 0, 0], [0, 0.01, 0], [0, 0, 0.01]]),
            "UncertainPose(x=1.0",
        ),
        "closure": (
            Closure(
                scan=3,
                i=0,
                j=7,
                pose=np.array([1.0, 0.5, 0.1]),
                covariance=np.eye(3),
                score=0.9,
                distance=1.0,
                outcome=ClosureOutcome.ACCEPTED,
            ),
            "Closure(0 to 7: ACCEPTED, x=1.000 m, y=0.500 m, theta=0.1000 rad)",
        ),
        "failed": (cs.match(*[cs.LaserScan([1.0], angle_min=0.0, angle_increment=0.1)] * 2), "MatchResult(curvescan: "),
        "simulation": (simulated, "Simulation('office"),
        "world": (simulated.world, "World('office'"),
        "pair": (pair, "ScanPair(x="),
        "slice": (simulated[1:3], "Log('office"),
        "held": (
            cs.log_from_arrays([(0.0, [1.0])], angle_min=0.0, angle_increment=0.1),
            "Log('arrays': scans in memory, 1 scan)",
        ),
        "trajectory": (run.trajectory, "Trajectory(6 poses over "),
        "empty": (run.trajectory[:0], "Trajectory(no pose)"),
        "run": (run, "Run('office"),
        "record": (run.record, "RunRecord('curvescan': 6 scans, 0 not matched)"),
        "odometry": (odometry, "Odometry('curvescan', 1 scan)"),
        "step": (step, "Step(0: STARTED, x=0.0000 m"),
        "localizer": (cs.Localizer(cs.run(simulated, "slam").map), "Localizer(curvescan: in a map of "),
        "builder": (builder, "OccupancyBuilder(1 scan in cells of 0.05 m)"),
        "grid": (builder.grid(), "OccupancyGrid("),
        "edge": (cs.PoseEdge(i=1, j=2, pose=(1.0, 2.0, 0.5), covariance=None), "PoseEdge(1 -> 2: x=1.0000 m"),
    }


def test_a_run_of_one_scan_says_so(objects):
    run = cs.run([objects["scan"][0]])
    assert ", 1 scan, 0 not matched" in repr(run)
    assert repr(run.record) == "RunRecord('curvescan': 1 scan, 0 not matched)"
    assert repr(cs.simulate("office", n_scans=1, seed=1)).startswith("Simulation('office (seed 1)': 1 scan of ")


NAMES = (
    "scan prepared match candidate uncertain failed simulation world pair slice held trajectory empty run record "
    "odometry step localizer builder "
    "grid edge"
)


@pytest.mark.parametrize("name", NAMES.split())
def test_the_repr_of_every_public_object_is_one_line(objects, name):
    value, start = objects[name]
    assert repr(value).startswith(start), repr(value)
    assert "\n" not in repr(value)
    assert len(repr(value)) < 160
