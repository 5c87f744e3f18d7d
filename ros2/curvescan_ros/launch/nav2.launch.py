"""Nav2 with curvescan in AMCL's place: `ros2 launch curvescan_ros nav2.launch.py map:=floor.yaml`.

map_server publishes the map, curvescan localizes in it and publishes map -> odom and amcl_pose, RViz's "2D Pose
Estimate" gives an initial pose where one helps, and Nav2's own navigation_launch.py does the rest.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node

ARGUMENTS = {
    "map": ("", "map.yaml of map_server"),
    "params_file": ("", "nav2_params.yaml of the robot; nav2_bringup's own by default"),
    "use_sim_time": ("false", "take the time from /clock"),
    "scan_topic": ("scan", "topic of the laser scans"),
}


def generate_launch_description() -> LaunchDescription:
    """Return map_server, curvescan, what brings both up, and Nav2's navigation."""
    share, nav2 = (Path(get_package_share_directory(name)) for name in ("curvescan_ros", "nav2_bringup"))
    value, config = LaunchConfiguration, str(share / "config" / "nav2.yaml")
    clock = {"use_sim_time": value("use_sim_time")}
    nodes = [
        LifecycleNode(
            package="nav2_map_server",
            executable="map_server",
            name="map_server",
            namespace="",
            output="screen",
            parameters=[{"yaml_filename": value("map")}, clock],
        ),
        LifecycleNode(
            package="curvescan_ros",
            executable="node",
            name="curvescan",
            namespace="",
            output="screen",
            parameters=[config, {"scan_topic": value("scan_topic")}, clock],
            remappings=[("pose", "amcl_pose")],
        ),
        Node(
            package="nav2_lifecycle_manager",
            executable="lifecycle_manager",
            name="lifecycle_manager_curvescan",
            output="screen",
            parameters=[config, {"node_names": ["map_server", "curvescan"]}, clock],
        ),
    ]
    navigation = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(nav2 / "launch" / "navigation_launch.py")),
        launch_arguments={"use_sim_time": value("use_sim_time"), "params_file": value("params_file")}.items(),
    )
    defaults = ARGUMENTS | {"params_file": (str(nav2 / "params" / "nav2_params.yaml"), ARGUMENTS["params_file"][1])}
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in defaults.items()
    ]
    return LaunchDescription([*declared, *nodes, navigation])
