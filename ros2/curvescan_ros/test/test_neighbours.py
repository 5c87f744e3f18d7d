"""Others on the network: another vendor's DDS, another domain; and the package as colcon builds it."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from test_node import as_mended, as_message_has_it, offline

PACKAGE = Path(__file__).parents[1]


def test_another_vendors_dds_is_answered(bench, scans, scans_file):
    pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")
    made = bench()
    made.play(scans_file, 40.0, player="foreign_player.py")
    assert len(made.odom) == len(scans)
    expected = offline(made.odom, as_mended([as_message_has_it(scan, scans[0]) for scan in scans]))
    for message, other in zip(made.odom, expected, strict=True):
        assert message.pose.pose == other.pose.pose
        assert message.twist.twist == other.twist.twist


def test_another_domain_is_not_heard(bench, scans_file, monkeypatch):
    made = bench()
    domain = int(os.environ["ROS_DOMAIN_ID"])
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain + 1))
    player = [sys.executable, Path(__file__).with_name("player.py"), scans_file, "40"]
    with subprocess.Popen(player) as process:
        time.sleep(8.0)
        process.kill()
    assert made.odom == []


def test_colcon_builds_the_package(tmp_path):
    colcon = shutil.which("colcon", path=str(Path(sys.executable).parent)) or shutil.which("colcon")
    if colcon is None:
        pytest.skip("colcon is not installed")
    shutil.copytree(PACKAGE, tmp_path / "src" / PACKAGE.name)
    build = [colcon, "build"]
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    built = subprocess.run(build, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300)
    assert built.returncode == 0, built.stderr
    prefix = tmp_path / "install" / "curvescan_ros"
    share = prefix / "share" / "curvescan_ros"
    assert (prefix / "lib" / "curvescan_ros" / "node").exists()
    assert (share / "launch" / "curvescan.launch.py").exists()
    assert (share / "rviz" / "curvescan.rviz").exists()
    assert (share / "config" / "curvescan.yaml").exists()
    assert any(prefix.rglob("curvescan_ros/node.py"))
