"""Starts the scene flow node.

ros2 launch mnsf_ros scene_flow.launch.py points:=/lidar/points
"""

from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchContext, LaunchDescription
from mnsf_ros.errors import SettingsError

SHARE = FindPackageShare("mnsf_ros")
FLOW_TOPICS = ("flow", "flow/moving", "flow/standing")
SHOWN_TOPICS = (*FLOW_TOPICS, "objects", "objects/markers", "ego_motion")

# Relative names are in the namespace.
ARGUMENTS = {
    "points": ("", "PointCloud2 topic of the lidar; empty: the only one that is published"),
    "odometry": ("odom", "Odometry topic of the robot, for ego_motion.source: odometry"),
    "flow": ("", "another name for ~/flow, also of ~/flow/moving and ~/flow/standing"),
    "params_file": (
        PathJoinSubstitution([SHARE, "config", "online.yaml"]),
        "parameter file; config/paper.yaml is the method as published",
    ),
    "name": ("scene_flow", "name of the node"),
    "namespace": ("", "namespace of the node"),
    "odom_frame": ("", "frame of ~/ego_motion; empty: NAMESPACE/scene_flow_odom"),
    "use_sim_time": ("false", "take the time from /clock"),
    "log_level": ("info", "debug, info, warn, error or fatal"),
    "rviz": ("false", "also open RViz"),
    "fixed_frame": ("", "frame that RViz shows, that of the clouds; empty: lidar"),
}


def generate_launch_description() -> LaunchDescription:
    """The node, and RViz if asked for."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ),
            OpaqueFunction(function=_nodes),
        ]
    )


def _nodes(context: LaunchContext) -> list[Node]:
    """Checks everything before the first process starts, so that none is left behind."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    if not Path(given["params_file"]).is_file():
        raise SettingsError(f"params_file: there is no file {given['params_file']}")
    if given["rviz"] not in ("true", "false") or given["use_sim_time"] not in ("true", "false"):
        raise SettingsError("rviz and use_sim_time: expected true or false")
    nodes = [_rviz(context, given)] if given["rviz"] == "true" else []
    return [_flow_node(given), *nodes]


def _flow_node(given: dict[str, str]) -> Node:
    frame = given["odom_frame"] or f"{given['namespace']}/scene_flow_odom".lstrip("/")
    remappings = [("~/points", _points(given["points"])), ("~/odometry", given["odometry"])]
    if given["flow"]:
        remappings += [(f"~/{name}", given["flow"] + name[4:]) for name in FLOW_TOPICS]
    return Node(
        package="mnsf_ros",
        executable="scene_flow_node",
        name=given["name"],
        namespace=given["namespace"],
        parameters=[
            given["params_file"],
            {"use_sim_time": given["use_sim_time"] == "true", "node.odom_frame": frame},
        ],
        remappings=remappings,
        ros_arguments=["--log-level", given["log_level"]],
        output="screen",
    )


def _points(topic: str) -> str:
    if topic:
        return topic
    from mnsf_ros.node.cloud_topics import only_cloud_topic

    return only_cloud_topic()


def _rviz(context: LaunchContext, given: dict[str, str]) -> Node:
    try:
        get_package_prefix("rviz2")
    except PackageNotFoundError:
        raise SettingsError("rviz: the package rviz2 is not installed") from None
    configuration = PathJoinSubstitution([SHARE, "rviz", "scene_flow.rviz"]).perform(context)
    pushed = context.launch_configurations.get("ros_namespace", "")
    full_name = "/".join(part for part in (pushed, given["namespace"], given["name"]) if part)
    names = {name: f"/{full_name.lstrip('/')}/{name}" for name in SHOWN_TOPICS}
    if given["flow"]:
        names |= {name: given["flow"] + name[4:] for name in FLOW_TOPICS}
    fixed_frame = ["--fixed-frame", given["fixed_frame"]] if given["fixed_frame"] else []
    return Node(
        package="rviz2",
        executable="rviz2",
        arguments=["-d", configuration, *fixed_frame],
        remappings=[(f"/scene_flow/{name}", full) for name, full in names.items()],
        output="screen",
    )
