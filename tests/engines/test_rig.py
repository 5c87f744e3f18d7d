"""Several lasers on one robot: joined as one laser at the base would see it, tracked, and their mounts found."""

from __future__ import annotations

import re
import sqlite3
from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.cli.main import run as command
from curvescan.cli.options import Reading
from curvescan.errors import InvalidArgumentError
from curvescan.runs.batch.jobs import digest_of
from curvescan.simulation.buildings.catalogue import build_world
from tests.bags import SECOND, scan, storage, transform, write_bag

MOUNTS = {"front": (0.35, 0.25, np.pi / 4), "rear": (-0.35, -0.25, -3 * np.pi / 4)}


def arc(n, speed=0.04, turn=0.02):
    """Poses of a base that drives along an arc, in the middle of the world's route."""
    world = build_world("office", 3)
    return se2.compose(np.array([*world.route[0], 0.3]), se2.exp(np.arange(n)[:, None] * np.array([speed, 0.0, turn])))


def recorded(poses, mounts=MOUNTS, world=None, seed=3):
    """Simulated logs of lasers on a base that takes these poses."""
    world = world or build_world("office", seed)
    return {
        name: cs.simulate(world, poses=se2.compose(poses, np.array(mount)), seed=seed + k, odometry_noise=None)
        for k, (name, mount) in enumerate(mounts.items())
    }


def rig_bag(path, logs, mounts):
    """A bag of the lasers' scans, and of transforms to those that `mounts` names."""
    entries = [transform(1, "base_link", laser, tuple(pose), topic="/tf_static") for laser, pose in mounts.items()]
    for laser, log in logs.items():
        for one in log:
            limits = {"angle_min": one.angle_min, "angle_increment": one.angle_increment, "range_max": one.range_max}
            stamp = round(1e9 * (1.0 + one.stamp))
            entries.append(scan(stamp, one.ranges, topic=f"/{laser}", frame=laser, scan_time=0.2, **limits))
    return write_bag(path, "mcap", sorted(entries, key=lambda entry: entry[2]))


def test_the_joined_scan_shows_each_reading_where_its_laser_saw_it():
    logs = recorded(arc(1))
    joined = cs.Rig(MOUNTS).join({name: log[0] for name, log in logs.items()})
    points = np.concatenate(
        [se2.transform(np.array(MOUNTS[n]), log[0].points[log[0].valid]) for n, log in logs.items()]
    )
    seen = joined.points[joined.valid]
    # every reading of the joined scan is one of a laser's, to the rounding of sine and cosine
    apart = np.linalg.norm(seen[:, None] - points[None], axis=2).min(axis=1)
    assert apart.max() < 1e-9
    assert len(seen) > 0.5 * len(points)
    assert joined.is_full_circle


def test_a_moving_base_moves_an_older_sweep_to_the_time_of_the_newest():
    logs = recorded(arc(2))
    front, rear = logs["front"][0], logs["rear"][1]  # 0.2 s later
    velocity = np.array([0.04, 0.0, 0.02]) / 0.2
    moved = cs.Rig(MOUNTS).join({"front": front, "rear": rear}, velocity)
    there = cs.Rig(MOUNTS).join({name: log[1] for name, log in logs.items()})
    assert moved.stamp == rear.stamp
    result = cs.match(there, moved)
    still = cs.match(there, cs.Rig(MOUNTS).join({"front": front, "rear": rear}))
    assert np.abs(result.pose[:2]).max() < 0.005
    assert np.linalg.norm(still.pose[:2]) > np.linalg.norm(result.pose[:2])


def test_nearer_things_hide_farther_ones():
    near = cs.LaserScan(np.full(181, 1.0), angle_min=-np.pi / 2, angle_increment=np.pi / 180, range_max=8.0)
    far = cs.LaserScan(np.full(181, 4.0), angle_min=-np.pi / 2, angle_increment=np.pi / 180, range_max=8.0)
    joined = cs.Rig({"a": (0.0, 0.0, 0.0), "b": (0.0, 0.0, 0.001)}).join({"a": near, "b": far})
    assert joined.ranges[joined.valid].max() < 1.1


def test_the_robots_own_body_is_left_out():
    scan = cs.LaserScan([0.3, 2.0, 2.0], angle_min=-0.1, angle_increment=0.1, range_max=8.0)
    joined = cs.Rig({"a": (0.0, 0.0, 0.0)}, body_radius=0.5).join({"a": scan})
    assert np.allclose(joined.ranges[joined.valid], 2.0)


def test_a_laser_that_dies_is_left_out_and_the_other_goes_on():
    logs = recorded(arc(6))
    groups = list(cs.Rig(MOUNTS).together({"front": logs["front"], "rear": logs["rear"][:3]}))
    assert [sorted(group) for group in groups] == [["front", "rear"]] * 3 + [["front"]] * 3


@pytest.mark.slow
def test_two_lasers_track_the_base_and_survive_the_loss_of_one():
    drive = cs.simulate("office", n_scans=40, seed=3)
    poses = drive.truth.poses
    logs = recorded(poses, world=drive.world)
    dying = {"front": logs["front"], "rear": logs["rear"][:20]}
    for given in (logs, dying):
        steps = list(cs.Rig(MOUNTS).track(given, cs.Odometry()))
        assert len(steps) == 40
        error = se2.between(se2.between(poses[0], poses[-1]), steps[-1].pose)
        # 1.6 m of way, matches of a few millimetres
        assert np.hypot(*error[:2]) < 0.02
        assert abs(error[2]) < 0.01


@pytest.mark.slow
def test_a_bag_of_two_lasers_is_read_as_one_log_and_mapped_by_one_flag(tmp_path, capsys):
    drive = cs.simulate("office", n_scans=30, seed=3)
    bag = rig_bag(tmp_path / "rig", recorded(drive.truth.poses, world=drive.world), MOUNTS)
    rig = cs.Rig.of_bag(bag)
    assert {name.strip("/"): tuple(np.round(mount, 6)) for name, mount in rig.mounts.items()} == {
        name: tuple(np.round(mount, 6)) for name, mount in MOUNTS.items()
    }
    log = rig.read(bag)
    assert (len(log), log.odometry) == (30, None)
    assert log[0].is_full_circle
    # as the rig tracks it scan by scan
    live = list(rig.track({name: cs.read_log(bag, topic=name) for name in rig.mounts}, cs.Odometry()))
    assert np.array_equal(cs.run(log, engine="odometry").trajectory.poses, [step.pose for step in live])
    assert command(["slam", str(bag), "--rig", "--out", str(tmp_path / "out")]) in (0, 3)
    assert len(cs.load_map(tmp_path / "out" / "map.csmap")) > 1
    assert command(["slam", str(bag)]) == 1
    assert "join them with --rig" in capsys.readouterr().err
    assert command(["slam", str(bag), "--rig", "--topic", "/front"]) == 1
    assert "--rig takes the lasers as the bag has them" in capsys.readouterr().err


def test_a_code_of_one_laser_is_no_wall_in_the_joined_scans(tmp_path, capsys):
    logs = recorded(arc(30))
    coded = [replace(one, ranges=np.where(one.ranges < 3.0, one.ranges, 3.0)) for one in logs["rear"]]
    bag = rig_bag(tmp_path / "rig", {**logs, "rear": coded}, MOUNTS)
    joined = cs.Rig.of_bag(bag).read(bag)
    mended, as_is = cs.run(joined, as_is=False), cs.run(joined, as_is=True)
    assert mended.prepared.remarks[0].startswith("/rear: ignored: readings beyond 2.87 m, codes for no return")
    assert as_is.prepared.done == ()

    def of_rear(scan):  # readings seen from the rear laser
        points = se2.transform(se2.inverse(np.array(MOUNTS["rear"])), scan.points[scan.valid])
        return np.linalg.norm(points, axis=1)

    at_code = [np.isclose(of_rear(run.scans[0]), 3.0, atol=1e-4).sum() for run in (mended, as_is)]
    assert at_code[0] == 0
    assert at_code[1] > 20
    capsys.readouterr()
    assert command(["info", str(bag), "--rig"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "/rear: 28.4% of all readings lie between 2.90 and 3.05 m" in out


@pytest.mark.slow
def test_a_batch_joins_the_lasers_of_its_bags_by_the_same_flag(tmp_path, capsys):
    bag, out = rig_bag(tmp_path / "rig", recorded(arc(4)), MOUNTS), tmp_path / "out"
    arguments = ["batch", str(bag), "--workers", "1", "--out", str(out)]
    assert command(arguments) == 1
    assert "join them with --rig" in capsys.readouterr().err
    assert command([*arguments, "--resume", "--rig"]) == 0
    alone = cs.run(cs.Rig.of_bag(bag).read(bag), engine="odometry")
    written = cs.read_poses(out / "rig" / "trajectory.csv").trajectory
    assert np.abs(written.poses - alone.trajectory.poses).max() < 1e-5  # as the file has them


def test_a_joined_log_has_other_options_than_one_of_a_laser(tmp_path):
    bag = rig_bag(tmp_path / "rig", recorded(arc(2)), MOUNTS)
    joined = Reading(rig=True).logs()
    assert (len(joined.open(bag)), joined.open(bag)[0].is_full_circle) == (2, True)
    assert digest_of(cs.OdometryJob(logs=joined)) != digest_of(cs.OdometryJob(logs=Reading().logs()))


def test_a_bag_whose_transforms_do_not_lead_to_a_laser_is_refused(tmp_path):
    bag = rig_bag(tmp_path / "rig", recorded(arc(2)), {"front": MOUNTS["front"]})
    with pytest.raises(InvalidArgumentError, match="do not to /rear: find the mounts"):
        cs.Rig.of_bag(bag)
    assert len(cs.Rig({f"/{name}": mount for name, mount in MOUNTS.items()}).read(bag)) == 2


def test_a_laser_whose_first_scan_is_broken_has_its_mount_by_the_next(tmp_path):
    mount = transform(1, "base_link", "laser", (0.5, 0.0, 0.0), topic="/tf_static")
    path = write_bag(tmp_path / "bag", "sqlite3", [mount, *(scan(k * SECOND) for k in range(1, 6))])
    with sqlite3.connect(storage(path)) as database:
        database.execute("update messages set data = 'junk' where timestamp = ?", (SECOND,))
    database.close()
    assert len(cs.read_log(path)) == 4
    assert cs.Rig.of_bag(path).mounts["/scan"].tolist() == [0.5, 0.0, 0.0]


def test_a_laser_that_the_statistics_of_a_bag_promise_and_that_is_not_there_is_told(tmp_path):
    mounts = [transform(1, "base_link", laser, tuple(pose), topic="/tf_static") for laser, pose in MOUNTS.items()]
    scans = [scan(k * SECOND, topic=f"/{laser}", frame=laser) for k, laser in enumerate(MOUNTS, 1)]
    path = write_bag(tmp_path / "bag", "mcap", [*mounts, *scans])
    file = storage(path)
    # the message of the third channel, a record of kind 5, becomes one of the second
    changed, n = re.subn(rb"(?s)(\x05.\0{7})\x03\0", b"\\1\x02\0", file.read_bytes())
    assert n == 1
    file.write_bytes(changed)
    with pytest.raises(InvalidArgumentError, match="do not to /rear: find the mounts"):
        cs.Rig.of_bag(path)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: cs.Rig({}), "at least one laser"),
        (lambda: cs.Rig({"a": (0.0, 1.0)}), "the mount of 'a' must be three finite numbers"),
        (lambda: cs.Rig({"a": ("x", 0, 0)}), "the mount of 'a' must be three finite numbers"),
        (lambda: cs.Rig(MOUNTS, body_radius="wide"), "body_radius must be a number, got 'wide'"),
        (lambda: cs.Rig(MOUNTS, body_radius=-1.0), "body_radius must be >= 0"),
        (lambda: cs.Rig(MOUNTS).join({}), "got none"),
        (lambda: cs.Rig(MOUNTS).join({"left": arc}), "must be of front, rear, got left"),
        (lambda: cs.Rig(MOUNTS).join({"front": arc}, (0.0, 1.0)), "velocity must be three finite numbers"),
        (lambda: next(cs.Rig(MOUNTS).together({"left": []})), "must be of front, rear, got left"),
        (lambda: cs.Rig(MOUNTS).together({"left": []}), "must be of front, rear, got left"),
        (lambda: cs.Rig(MOUNTS).track({"left": []}, cs.Odometry()), "must be of front, rear, got left"),
    ],
)
def test_bad_arguments_are_told(call, sentence):
    with pytest.raises(InvalidArgumentError, match=sentence):
        call()
