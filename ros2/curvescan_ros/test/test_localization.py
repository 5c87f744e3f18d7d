"""Localization as Nav2 uses it: lifecycle states, an initial pose from RViz, a map of map_server."""

import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

import yaml
from curvescan_ros.messages import grid_of, initial_pose_of, map_message, pose_message, transform_pose
from curvescan_ros.node import LATCHED, PARAMETERS, CurvescanNode
from geometry_msgs.msg import PoseWithCovarianceStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import OccupancyGrid
from rclpy.parameter import Parameter

import curvescan
from conftest import HERE, save_scans
from curvescan import se2
from curvescan.mapping.map_server import write_map
from curvescan.simulation import World
from curvescan.types import UncertainPose


@pytest.fixture(scope="module")
def drive():
    """A hall that looks the same from both ends: only an initial pose tells which."""
    world = World(
        name="hall",
        walls=np.array([[0.0, 0.0, 9.0, 0.0], [9.0, 0.0, 9.0, 5.0], [9.0, 5.0, 0.0, 5.0], [0.0, 5.0, 0.0, 0.0]]),
        boxes=np.array(
            [[2.0, 0.5, 1.2, 0.6, 0.0], [7.0, 4.5, 1.2, 0.6, 0.0], [0.5, 3.2, 0.5, 1.4, 0.0], [8.5, 1.8, 0.5, 1.4, 0.0]]
        ),
        circles=np.array([[3.0, 3.4, 0.2], [6.0, 1.6, 0.2]]),
    )
    angle = np.linspace(0.3, 0.3 + 2.0 * np.pi, 120)
    x, y = 4.5 + 1.0 * np.cos(angle), 2.5 + 1.5 * np.sin(angle)
    way = np.column_stack((x, y, np.arctan2(1.5 * np.cos(angle), -np.sin(angle))))
    slam = curvescan.Slam()
    for scan in curvescan.simulate(world, poses=way, seed=1, odometry_noise=None):
        slam.add(scan)
    slam.finish()
    later = list(curvescan.simulate(world, poses=way[10:40], seed=5, odometry_noise=None))
    return slam.map, later, se2.between(way[0], way[10:40])


def say_initial_pose(made, pose, frame="map"):
    publisher = made.listener.create_publisher(PoseWithCovarianceStamped, "/initialpose", 10)
    deadline = time.monotonic() + 10.0
    while publisher.get_subscription_count() == 0 and time.monotonic() < deadline:
        time.sleep(0.1)
    cov = np.diag(np.square([0.7, 0.7, np.radians(15.0)]))
    message = pose_message(made.node.get_clock().now().to_msg(), UncertainPose(np.asarray(pose), cov), frame)
    publisher.publish(message)
    time.sleep(1.0)


@pytest.mark.parametrize("name", ["floor.csmap", "floor.yaml"])
def test_an_initial_pose_from_rviz_decides(bench, drive, tmp_path, name):
    slam_map, later, true = drive
    slam_map.save(tmp_path / "floor.csmap")
    write_map(tmp_path, slam_map.occupancy(), "floor")
    n = 10
    made = bench(mode="localization", map_file=str(tmp_path / name), base_frame_id="laser")
    made.play(save_scans(tmp_path / "begin.npz", later[:n]), 0.0)
    assert made.poses == []  # the two ends look alike
    say_initial_pose(made, true[n] + (0.8, 0.6, np.radians(20.0)), frame="odom")  # left out: not in the map
    say_initial_pose(made, true[n] + (0.8, 0.6, np.radians(20.0)))
    made.play(save_scans(tmp_path / "rest.npz", later[n:]), 0.0)
    assert len(made.poses) == len(later) - n
    for message, pose in zip(made.poses, true[n:], strict=True):
        assert message.header.frame_id == "map"
        here = initial_pose_of(message)
        assert np.hypot(*(here.pose - pose)[:2]) < 0.15
        assert (np.linalg.eigvalsh(here.covariance) > 0.0).all()


def test_a_map_of_map_server_is_localized_in_when_it_comes(bench, drive, tmp_path):
    slam_map, later, true = drive
    made = bench(
        mode="localization",
        base_frame_id="laser",
        set_initial_pose=True,
        **{
            "initial_pose.x": float(true[0, 0]) + 0.4,
            "initial_pose.y": float(true[0, 1]) - 0.3,
            "initial_pose.yaw": float(true[0, 2]) + 0.2,
        },
    )
    time.sleep(1.5)
    assert "no map yet: nobody published map" in made.reports[-1].status[0].message
    publisher = made.listener.create_publisher(OccupancyGrid, "map", LATCHED)
    publisher.publish(map_message(made.node.get_clock().now().to_msg(), slam_map.occupancy(), "map"))
    deadline = time.monotonic() + 60.0
    while made.node._tracker is None and time.monotonic() < deadline:
        time.sleep(0.2)
    made.play(save_scans(tmp_path / "drive.npz", later), 0.0)
    assert len(made.poses) == len(later)
    assert np.hypot(*(initial_pose_of(made.poses[-1]).pose - true[-1])[:2]) < 0.15


def test_a_grid_comes_back_from_its_message():
    log_odds = np.array([[0.0, 2.0, -2.0], [-2.0, 0.0, 2.0]], dtype=np.float32)
    config = curvescan.OccupancyConfig(resolution=0.1)
    grid = curvescan.OccupancyGrid(log_odds=log_odds, origin=np.array([1.0, -2.0]), config=config)
    again = grid_of(map_message(stamp_of(3), grid, "map"))
    assert np.array_equal(np.sign(again.log_odds), np.sign(log_odds))
    assert again.origin.tolist() == [1.0, -2.0]
    assert again.resolution == pytest.approx(0.1)


def stamp_of(seconds):
    from builtin_interfaces.msg import Time

    return Time(sec=seconds)


def test_the_states_of_its_life(bench, drive, tmp_path):
    slam_map, later, true = drive
    slam_map.save(tmp_path / "floor.csmap")
    made = bench(
        mode="localization", map_file=str(tmp_path / "floor.csmap"), use_lifecycle_manager=True, base_frame_id="laser"
    )

    def state():
        return made.call("/curvescan/get_state", GetState, GetState.Request()).current_state.label

    def change(transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return made.call("/curvescan/change_state", ChangeState, request).success

    file = save_scans(tmp_path / "drive.npz", later[:8])
    assert state() == "unconfigured"
    assert change(Transition.TRANSITION_CONFIGURE)
    assert state() == "inactive"
    assert made.node.count_subscribers("scan") == 0
    assert change(Transition.TRANSITION_ACTIVATE)
    assert state() == "active"
    say_initial_pose(made, true[0])
    made.play(file, 0.0)
    assert len(made.odom) == 8
    assert change(Transition.TRANSITION_DEACTIVATE)
    assert made.node.count_subscribers("scan") == 0
    assert change(Transition.TRANSITION_CLEANUP)
    assert state() == "unconfigured"
    assert change(Transition.TRANSITION_CONFIGURE)
    assert change(Transition.TRANSITION_ACTIVATE)
    made.play(file, 0.0)
    assert len(made.odom) == 16


def test_what_cannot_be_configured_says_why():
    with pytest.raises(curvescan.CurvescanError, match=r"none\.csmap does not exist"):
        CurvescanNode(
            parameter_overrides=[Parameter("mode", value="localization"), Parameter("map_file", value="none.csmap")]
        )
    node = CurvescanNode(
        parameter_overrides=[Parameter("mode", value="mapping"), Parameter("use_lifecycle_manager", value=True)]
    )
    assert node.trigger_configure().name == "FAILURE"
    node.destroy_node()


def test_somebody_elses_odom_is_listened_to(bench):
    made = bench(provide_odom_frame=False, base_frame_id="base_footprint")
    node = made.node
    rotation = SimpleNamespace(x=0.0, y=0.0, z=np.sin(0.1), w=np.cos(0.1))

    def moved(parent, child, seconds, x):
        transform = SimpleNamespace(translation=SimpleNamespace(x=x, y=0.0, z=0.0), rotation=rotation)
        header = SimpleNamespace(frame_id=parent, stamp=stamp_of(seconds))
        return SimpleNamespace(header=header, child_frame_id=child, transform=transform)

    node._on_tf(SimpleNamespace(transforms=[moved("odom", "base_footprint", 1, 0.5), moved("map", "odom", 1, 9.0)]))
    node._on_tf(SimpleNamespace(transforms=[moved("odom", "base_footprint", 2, 0.7)]))
    node._on_tf(SimpleNamespace(transforms=[moved("odom", "another_robot", 2, 4.0)]))
    assert [when for when, _ in node._wheels] == [1.0, 2.0]
    scan = curvescan.LaserScan(np.ones(4), angle_min=0.0, angle_increment=0.1, range_min=0.0, range_max=9.0, stamp=1.5)
    assert np.allclose(node._wheel_pose(scan), [0.6, 0.0, 0.2])


@pytest.mark.parametrize("is_ours", [True, False])
def test_map_odom_holds_for_a_while_and_fits_the_odom_that_there_is(bench, is_ours):
    made = bench(provide_odom_frame=is_ours, base_frame_id="base_footprint", transform_tolerance=0.5)
    node, sent = made.node, []
    node._tf, node._tf_type = SimpleNamespace(publish=sent.append), lambda transforms: transforms
    node._p["mode"], node._child_frame = "localization", "base_footprint"
    in_map, wheels = np.array([3.0, 1.0, 0.5]), np.array([1.0, -2.0, 0.2])
    map_odom = se2.compose(in_map, se2.inverse(wheels))
    state = SimpleNamespace(map_odom=map_odom if is_ours else None, odom_base=UncertainPose(wheels, np.eye(3)))
    node._publish_tf(stamp_of(10), state, UncertainPose(in_map, np.eye(3)), wheels)
    frames = [(t.header.frame_id, t.child_frame_id) for t in sent[0]]
    assert frames == [("odom", "base_footprint")] * is_ours + [("map", "odom")]
    last = sent[0][-1]
    assert last.header.stamp.sec + 1e-9 * last.header.stamp.nanosec == pytest.approx(10.5)
    assert np.allclose(transform_pose(last.transform), map_odom)
    # without wheels at a scan what was known of odom stays
    node._publish_tf(stamp_of(11), state, None, None)
    assert np.allclose(transform_pose(sent[1][-1].transform), map_odom)


@pytest.mark.parametrize(("file", "node"), [("curvescan.yaml", "curvescan"), ("nav2.yaml", "curvescan")])
def test_parameter_files_name_parameters_that_there_are(file, node):
    read = yaml.safe_load((HERE.parent / "config" / file).read_text())
    given = read[node]["ros__parameters"]
    assert given.keys() <= PARAMETERS.keys()
    for name, value in given.items():
        assert type(value) is type(PARAMETERS[name]), name


@pytest.mark.parametrize("file", ["curvescan.launch.py", "nav2.launch.py"])
def test_launch_files_compile(file):
    path = HERE.parent / "launch" / file
    subprocess.run([sys.executable, "-m", "py_compile", path], check=True)
