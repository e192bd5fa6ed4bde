# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Starts the scene flow node.

ros2 launch mnsf_ros scene_flow.launch.py points:=/lidar/points
ros2 launch mnsf_ros scene_flow.launch.py bag:=recording
"""

from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    ExecuteProcess,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessStart
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode, Node
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare
from lifecycle_msgs.msg import Transition

from launch import Action, LaunchContext, LaunchDescription
from mnsf_ros.errors import SettingsError

SHARE = FindPackageShare("mnsf_ros")
FLOW_TOPICS = ("flow", "flow/moving", "flow/standing")
SHOWN_TOPICS = (*FLOW_TOPICS, "objects", "objects/markers", "ego_motion")

SWITCHES = ("lifecycle", "autostart", "use_sim_time", "rviz", "view")
ON_WITH_A_BAG = ("use_sim_time", "view")

# Relative names are in the namespace.
ARGUMENTS = {
    "points": (
        "",
        "topic of the lidar's clouds, or topics of several, separated by commas; empty or auto: "
        "the only one that is published, or in the bag",
    ),
    "bag": ("", "recording that is played to the node, from when the node listens"),
    "odometry": ("odom", "Odometry topic of the robot, for ego_motion.source: odometry"),
    "flow": ("", "another name for ~/flow, also of ~/flow/moving and ~/flow/standing"),
    "params_file": (
        PathJoinSubstitution([SHARE, "config", "online.yaml"]),
        "parameter file; config/paper.yaml is the method as published",
    ),
    "name": ("scene_flow", "name of the node"),
    "namespace": ("", "namespace of the node"),
    "odom_frame": ("", "frame of ~/ego_motion; empty: NAMESPACE/scene_flow_odom"),
    "lifecycle": ("false", "start the node with a life cycle (scene_flow_lifecycle_node)"),
    "autostart": ("true", "configure and activate a node with a life cycle"),
    "use_sim_time": ("", "take the time from /clock; empty: only with a bag"),
    "log_level": ("info", "debug, info, warn, error or fatal"),
    "rviz": ("false", "also open RViz"),
    "view": ("", "show the flow in a browser; empty: only with a bag"),
    "view_port": ("8766", "port of that page; a second view on one computer needs another"),
    "fixed_frame": ("", "frame of the clouds, for RViz; empty: that in the bag, or lidar"),
}


def generate_launch_description() -> LaunchDescription:
    """The node; a recording for it, RViz and the view in a browser if asked for."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=text)
                for name, (default, text) in ARGUMENTS.items()
            ),
            OpaqueFunction(function=_nodes),
        ]
    )


def _nodes(context: LaunchContext) -> list[Action]:
    """Checks everything before the first process starts, so that none is left behind."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    if not Path(given["params_file"]).is_file():
        raise SettingsError(f"params_file: there is no file {given['params_file']}")
    if given["points"] == "auto":
        given["points"] = ""
    if given["bag"]:
        _look_into_bag(given)
    for name in ON_WITH_A_BAG:
        given[name] = given[name] or str(bool(given["bag"]))
    for name in SWITCHES:
        # As Python and ROS 1 spell them, too.
        given[name] = given[name].lower()
        if given[name] not in ("true", "false"):
            raise SettingsError(f"{name}: got {given[name]!r}, expected true or false")
    rviz = [_rviz(context, given)] if given["rviz"] == "true" else []
    node = _flow_node(given)
    is_started = given["lifecycle"] == "true" and given["autostart"] == "true"
    return [
        *(_transitions(node) if is_started else ()),
        node,
        *rviz,
        *([_view(context, given)] if given["view"] == "true" else ()),
        *([_mnsf("play", given["bag"], "--clock", "--wait")] if given["bag"] else ()),
    ]


def _flow_node(given: dict[str, str]) -> Node:
    frame = given["odom_frame"] or f"{given['namespace']}/scene_flow_odom".lstrip("/")
    # The node itself looks for the topic that nobody names.
    topics = given["points"].split(",") if given["points"] else []
    own_names = ["~/points", *(f"~/points_{number}" for number in range(2, len(topics) + 1))]
    remappings = [*zip(own_names, topics, strict=False), ("~/odometry", given["odometry"])]
    several = {"lidars.count": len(topics)} if len(topics) > 1 else {}
    if given["flow"]:
        remappings += [(f"~/{name}", given["flow"] + name[4:]) for name in FLOW_TOPICS]
    has_life_cycle = given["lifecycle"] == "true"
    return (LifecycleNode if has_life_cycle else Node)(
        package="mnsf_ros",
        executable="scene_flow_lifecycle_node" if has_life_cycle else "scene_flow_node",
        name=given["name"],
        namespace=given["namespace"],
        parameters=[
            given["params_file"],
            {"use_sim_time": given["use_sim_time"] == "true", "node.odom_frame": frame} | several,
        ],
        remappings=remappings,
        ros_arguments=["--log-level", given["log_level"]],
        output="screen",
    )


def _transitions(node: LifecycleNode) -> list[Action]:
    """Configures the node as soon as it runs, and then activates it: once, not after each stop."""
    change = {
        number: EmitEvent(
            event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=number)
        )
        for number in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)
    }
    configured = OnStateTransition(
        target_lifecycle_node=node,
        start_state="configuring",
        goal_state="inactive",
        entities=[change[Transition.TRANSITION_ACTIVATE]],
    )
    started = OnProcessStart(target_action=node, on_start=[change[Transition.TRANSITION_CONFIGURE]])
    return [RegisterEventHandler(configured), RegisterEventHandler(started)]


def _look_into_bag(given: dict[str, str]) -> None:
    """Names the topic of the lidar and the frame of its clouds, unless they are given."""
    from mnsf_ros.recording.bag_reader import BagReader
    from mnsf_ros.recording.bag_topics import used_topics

    with BagReader(given["bag"]) as reader:
        if not given["points"]:
            given["points"] = used_topics(reader.path, reader.topics).points
            cloud = next(reader.messages(given["points"]))
            given["fixed_frame"] = given["fixed_frame"] or cloud.header.frame_id


def _mnsf(*words: str) -> Action:
    program = ExecutableInPackage(package="mnsf_ros", executable="mnsf")
    return ExecuteProcess(cmd=[program, *words], output="screen")


def _view(context: LaunchContext, given: dict[str, str]) -> Action:
    name, flow = _full_name(context, given), given["flow"]
    if flow and not flow.startswith("/"):
        flow = f"{name.rpartition('/')[0]}/{flow}"
    words = ("--flow", flow) if flow else ()
    return _mnsf("view", "--node", name, *words, "--port", given["view_port"])


def _full_name(context: LaunchContext, given: dict[str, str]) -> str:
    pushed = context.launch_configurations.get("ros_namespace", "")
    full_name = "/".join(part for part in (pushed, given["namespace"], given["name"]) if part)
    return f"/{full_name.lstrip('/')}"


def _rviz(context: LaunchContext, given: dict[str, str]) -> Node:
    try:
        get_package_prefix("rviz2")
    except PackageNotFoundError:
        raise SettingsError("rviz: the package rviz2 is not installed") from None
    configuration = PathJoinSubstitution([SHARE, "rviz", "scene_flow.rviz"]).perform(context)
    names = {name: f"{_full_name(context, given)}/{name}" for name in SHOWN_TOPICS}
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
