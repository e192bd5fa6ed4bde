"""Starts the scene flow node.

ros2 launch mnsf_ros scene_flow.launch.py points:=/lidar/points
"""

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

SHARE = FindPackageShare("mnsf_ros")

ARGUMENTS = {
    "points": ("/points", "PointCloud2 topic of the lidar"),
    "odometry": ("/odom", "Odometry topic of the robot, for ego_motion.source: odometry"),
    "flow": ("/scene_flow/flow", "topic of the flow"),
    "params_file": (
        PathJoinSubstitution([SHARE, "config", "online.yaml"]),
        "parameter file; config/paper.yaml is the method as published",
    ),
    "namespace": ("", "namespace of the node"),
    "use_sim_time": ("false", "take the time from /clock"),
    "rviz": ("false", "also open RViz"),
}


def generate_launch_description() -> LaunchDescription:
    """The node, and RViz if asked for."""
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    use_sim_time = ParameterValue(given["use_sim_time"], value_type=bool)
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ),
            Node(
                package="mnsf_ros",
                executable="scene_flow_node",
                name="scene_flow",
                namespace=given["namespace"],
                parameters=[given["params_file"], {"use_sim_time": use_sim_time}],
                remappings=[(f"~/{name}", given[name]) for name in ("points", "odometry", "flow")],
                output="screen",
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", PathJoinSubstitution([SHARE, "rviz", "scene_flow.rviz"])],
                remappings=[("/scene_flow/flow", given["flow"])],
                condition=IfCondition(given["rviz"]),
            ),
        ]
    )
