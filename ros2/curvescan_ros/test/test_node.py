"""The node over a real middleware: a publisher process plays scans, and what comes back equals offline to the bit."""

import time
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from curvescan_ros.messages import add_transforms, odometry_message
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import LaserScan

import curvescan
from conftest import save_scans
from curvescan import se2
from curvescan.diagnostics.preparation import StreamMender
from curvescan.io.ros.messages import scan_of
from curvescan.live.base_motion import BaseMotion


def offline(messages_like, scans):
    """What the node must say of each scan."""
    odometry, motion = curvescan.Odometry(), BaseMotion(np.zeros(3))
    for message, scan in zip(messages_like, scans, strict=True):
        state = motion.add(odometry.add(scan), scan.stamp)
        yield odometry_message(message.header.stamp, state, "odom", "laser")


def as_mended(scans):
    """Scans as the node takes them."""
    mender = StreamMender(print)
    return [mender.add(scan) for scan in scans]


def as_message_has_it(scan, first):
    """A scan after float32 and whole nanoseconds, with the times of the first as the player has them."""
    return curvescan.LaserScan(
        scan.ranges.astype(np.float32),
        angle_min=float(np.float32(scan.angle_min)),
        angle_increment=float(np.float32(scan.angle_increment)),
        range_min=float(np.float32(scan.range_min)),
        range_max=float(np.float32(scan.range_max)),
        time_increment=float(np.float32(first.time_increment)),
        scan_time=float(np.float32(first.scan_time)),
        stamp=stamp_of_nanoseconds(round(scan.stamp * 1e9)),
    )


def stamp_of_nanoseconds(nanoseconds):
    from builtin_interfaces.msg import Time
    from std_msgs.msg import Header

    from curvescan.io.ros.messages import stamp_of

    return stamp_of(Header(stamp=Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)))


def test_every_scan_is_answered_and_equals_offline_to_the_bit(bench, scans, scans_file):
    made = bench()
    made.play(scans_file, 40.0)
    assert len(made.odom) == len(scans)
    expected = offline(made.odom, as_mended([as_message_has_it(scan, scans[0]) for scan in scans]))
    for message, other in zip(made.odom, expected, strict=True):
        assert message.pose.pose == other.pose.pose
        assert np.array_equal(message.pose.covariance, other.pose.covariance)
        assert np.array_equal(message.twist.covariance, other.twist.covariance)
        assert message.twist.twist == other.twist.twist
    # no leap: a step is what the twist says
    xy = np.array([(m.pose.pose.position.x, m.pose.pose.position.y) for m in made.odom])
    assert np.hypot(*np.diff(xy, axis=0).T).max() < 0.5
    grid = made.maps[-1]
    assert len(grid.data) == grid.info.width * grid.info.height > 0
    assert {-1, *range(101)} >= set(grid.data)
    status = made.reports[-1].status[0]
    values = {item.key: item.value for item in status.values}
    assert int(values["scans"]) == len(scans)
    assert int(values["lost by the middleware"]) == 0


@pytest.mark.parametrize("as_is", [False, True])
def test_codes_for_no_return_are_left_out_unless_they_are_to_be_kept(bench, tmp_path, as_is):
    rng, spoilt = np.random.default_rng(5), []
    for scan in curvescan.simulate("office", sensor="spinning-360", n_scans=130, seed=2):
        ranges = np.where(rng.random(len(scan)) < 0.05, 33.0, scan.ranges)
        spoilt.append(replace(scan, ranges=ranges, range_max=40.0))
    said = []
    mender = StreamMender(said.append)
    heard = [as_message_has_it(scan, spoilt[0]) for scan in spoilt]
    mended = [mender.add(scan) for scan in heard]
    made = bench(as_is=as_is)
    made.play(save_scans(tmp_path / "spoilt.npz", spoilt), 40.0)
    expected = list(offline(made.odom, heard if as_is else mended))
    assert [message.pose.pose for message in made.odom] == [message.pose.pose for message in expected]
    (sentence,) = said
    assert sentence.startswith("from scan 100 on ignored: readings beyond")
    assert any(np.any(one.valid != other.valid) for one, other in zip(mended, heard, strict=True))


def test_what_is_missing_is_said(bench):
    made = bench()
    time.sleep(2.5)
    status = made.reports[-1].status[0]
    assert status.level == status.ERROR
    assert "nobody publishes /scan" in status.message
    made.listener.create_publisher(LaserScan, "front/scan", 1)
    time.sleep(2.5)
    assert "laser scans are on /front/scan: remap scan" in made.reports[-1].status[0].message


def test_services(bench, scans_file, tmp_path):
    made = bench(map_file=str(tmp_path / "floor.csmap"))
    made.play(scans_file, 100.0)
    answer = made.call("/curvescan/save_map")
    assert answer.success, answer.message
    assert (tmp_path / "floor.pgm").read_bytes().startswith(b"P5")
    assert made.call("/curvescan/reset").success
    n = len(made.odom)
    made.play(scans_file, 100.0)
    first = made.odom[n].pose.pose
    assert (first.position.x, first.position.y, first.orientation.z) == (0.0, 0.0, 0.0)


def test_in_a_saved_map_that_map_is_published_first(bench, scans, scans_file, tmp_path):
    heard = [as_message_has_it(scan, scans[0]) for scan in scans]
    slam = curvescan.Slam()
    for scan in heard:
        slam.add(scan)
    slam.map.save(tmp_path / "floor.csmap")
    localizer = curvescan.Localizer(curvescan.load_map(tmp_path / "floor.csmap"))
    expected = Counter(localizer.add(scan).outcome.name.lower() for scan in as_mended(heard))
    made = bench(mode="localization", map_file=str(tmp_path / "floor.csmap"))
    time.sleep(2.0)
    first = made.maps[0]  # before any scan
    assert first.header.frame_id == "map"
    assert np.count_nonzero(np.array(first.data) > 50) > 500
    made.play(scans_file, 0.0)  # none is dropped, whatever the machine does besides
    assert len(made.odom) == len(scans)
    values = {item.key: item.value for item in made.reports[-1].status[0].values}
    found = {name: int(values.get(f"outcome {name}", 0)) for name in expected}
    assert found == expected
    assert expected["found"] >= 1
    assert expected["tracked"] >= 0.95 * len(scans)
    assert made.maps[-1].info.width >= first.info.width


@pytest.mark.parametrize("n_rear", [60, 30])
def test_two_lasers_are_followed_as_one_at_the_base_also_when_one_fails(bench, n_rear):
    mounts = {"front": np.array([0.35, 0.25, 0.785]), "rear": np.array([-0.35, -0.25, -2.356])}
    drive = curvescan.simulate("office", n_scans=60, seed=3)
    logs = {
        name: list(
            curvescan.simulate(drive.world, poses=se2.compose(drive.truth.poses, mount), seed=k, odometry_noise=None)
        )
        for k, (name, mount) in enumerate(mounts.items())
    }
    made = bench(scan_topics=["front/scan", "rear/scan"])
    for name, mount in mounts.items():
        add_transforms(made.node._tree, static_transform("base_link", name, mount))
    publishers = {name: made.listener.create_publisher(LaserScan, f"{name}/scan", 10) for name in mounts}
    time.sleep(1.0)
    for k in range(60):
        for name, log in logs.items():
            if name == "front" or k < n_rear:
                publishers[name].publish(message_of(log[k], name))
        # a laser that is silent is waited for until the other one's next sweep
        deadline = time.monotonic() + 20.0
        while len(made.odom) < k + (k < n_rear) and time.monotonic() < deadline:
            time.sleep(0.01)
    assert len(made.odom) == 60 - (n_rear < 60)
    last = made.odom[-1]
    assert (last.header.frame_id, last.child_frame_id) == ("odom", "base_link")
    # as the rig tracks them offline, with readings of float32 and stamps of nanoseconds
    heard = {
        name: [scan_of(message_of(scan, name)) for scan in log[: n_rear if name == "rear" else 60]]
        for name, log in logs.items()
    }
    motion = BaseMotion(np.zeros(3))
    offline = [
        motion.add(step, step.stamp).odom_base.pose for step in curvescan.Rig(mounts).track(heard, curvescan.Odometry())
    ]
    places = [(m.pose.pose.position.x, m.pose.pose.position.y) for m in made.odom]
    assert np.allclose(places, np.array(offline)[: len(places), :2], atol=1e-5)
    true = se2.between(drive.truth.poses[0], drive.truth.poses[len(places) - 1])
    assert np.hypot(*(places[-1] - true[:2])) < 0.02 * np.hypot(*true[:2])
    # anew: mounts are known by then
    assert made.call("/curvescan/reset").success
    n = len(made.odom)
    for name, log in logs.items():
        publishers[name].publish(message_of(log[0], name))
    deadline = time.monotonic() + 20.0
    while len(made.odom) == n and time.monotonic() < deadline:
        time.sleep(0.01)
    assert made.odom[n].pose.pose.position.x == 0.0


def message_of(scan, frame):
    message = LaserScan(
        angle_min=scan.angle_min, angle_increment=scan.angle_increment, range_max=scan.range_max, scan_time=0.2
    )
    message.header.frame_id = frame
    nanoseconds = round(1e9 * (1.0 + scan.stamp))
    message.header.stamp.sec, message.header.stamp.nanosec = nanoseconds // 10**9, nanoseconds % 10**9
    message.ranges = scan.ranges.astype(np.float32).tolist()
    return message


def static_transform(parent, child, pose):
    translation = SimpleNamespace(x=pose[0], y=pose[1], z=0.0)
    rotation = SimpleNamespace(x=0.0, y=0.0, z=np.sin(0.5 * pose[2]), w=np.cos(0.5 * pose[2]))
    header = SimpleNamespace(frame_id=parent)
    transform = SimpleNamespace(translation=translation, rotation=rotation)
    return SimpleNamespace(transforms=[SimpleNamespace(header=header, child_frame_id=child, transform=transform)])


def test_transforms(bench, scans, scans_file):
    """The laser is ahead of the base and turned by 90 degrees, which /tf_static says: poses are those of the base."""
    tf2 = pytest.importorskip("tf2_msgs.msg", reason="tf2_msgs is not built")
    if not hasattr(tf2, "TFMessage"):  # what is found is the folder that it is built from, beside this file
        pytest.skip("tf2_msgs is not built")
    from geometry_msgs.msg import TransformStamped

    made = bench(mode="slam")
    static = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = made.listener.create_publisher(tf2.TFMessage, "/tf_static", static)
    ahead, turned = TransformStamped(), TransformStamped()
    ahead.header.frame_id, ahead.child_frame_id = "base_link", "mast"
    ahead.transform.translation.x = 0.3
    ahead.transform.rotation.w = 1.0
    turned.header.frame_id, turned.child_frame_id = "mast", "laser"
    turned.transform.rotation.z = turned.transform.rotation.w = np.sqrt(0.5)
    publisher.publish(tf2.TFMessage(transforms=[ahead, turned]))
    made.listener.create_subscription(tf2.TFMessage, "/tf", made.tf.append, QoSProfile(depth=1000))
    made.play(scans_file, 40.0)
    names = [[(t.header.frame_id, t.child_frame_id) for t in m.transforms] for m in made.tf]
    assert names
    assert all(n == [("odom", "base_link"), ("map", "odom")] for n in names)
    assert made.odom[0].child_frame_id == "base_link"
    assert len(made.odom) == len(scans)
    odometry = curvescan.Slam()
    motion = BaseMotion(np.array([0.3, 0.0, np.pi / 2]))
    for message, scan in zip(made.odom, scans, strict=True):
        state = motion.add(odometry.add(as_message_has_it(scan, scans[0])), scan.stamp)
        assert message.pose.pose.position.x == pytest.approx(state.odom_base.pose[0], abs=1e-9)
        assert message.pose.pose.position.y == pytest.approx(state.odom_base.pose[1], abs=1e-9)
    # the stamp is that of the middle of the sweep
    half = 0.5 * (len(scans[0]) - 1) * scans[0].time_increment
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in made.odom]
    assert np.allclose(np.array(stamps) - [scan.stamp for scan in scans], half, atol=1e-6)
    tf_stamps = [m.transforms[0].header.stamp for m in made.tf]
    assert set(map(str, tf_stamps)) <= {str(m.header.stamp) for m in made.odom}
