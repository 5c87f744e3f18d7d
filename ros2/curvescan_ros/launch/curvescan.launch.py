"""Run the node: `ros2 launch curvescan_ros curvescan.launch.py scan:=/scan mode:=slam rviz:=true`."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    "scan": ("scan", "topic of the laser scans"),
    "wheel_odom": ("wheel_odom", "topic of the wheel odometry, with use_odom_prior"),
    "mode": ("slam", "odometry, slam or localization"),
    "map_file": ("", "map to localize in (.csmap, or .yaml of a plain map), or to save to"),
    "use_sim_time": ("false", "take the time from /clock"),
    "rviz": ("false", "open rviz"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the node, and rviz where it is asked for."""
    share = Path(get_package_share_directory("curvescan_ros"))
    value = LaunchConfiguration
    node = Node(
        package="curvescan_ros",
        executable="node",
        name="curvescan",
        output="screen",
        parameters=[
            str(share / "config" / "curvescan.yaml"),
            {name: value(name) for name in ("mode", "map_file", "use_sim_time")},
        ],
        remappings=[("scan", value("scan")), ("wheel_odom", value("wheel_odom"))],
    )
    rviz = Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", str(share / "rviz" / "curvescan.rviz")],
        condition=IfCondition(value("rviz")),
    )
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, node, rviz])
