"""The command line of the node: what is not for ROS is a mistake."""

from __future__ import annotations

import argparse

from mnsf_ros import __version__

_DESCRIPTION = """\
Estimates the scene flow of a lidar: how every point of each sweep moves.

  in   ~/points (sensor_msgs/PointCloud2), ~/odometry (nav_msgs/Odometry, if asked for)
  out  ~/flow, ~/flow/moving, ~/flow/standing, ~/objects, ~/ego_motion, /diagnostics"""
_LIFE_CYCLE = """

It starts unconfigured: ros2 lifecycle set /scene_flow configure, then activate."""
_EPILOG = """\
ROS arguments:
  -r '~/points:=/lidar/points'    topic of the lidar
  -r __ns:=/front                 namespace
  -r __node:=flow                 name, scene_flow by default
  -p crop.max_range_m:=60         a parameter; all of them: mnsf parameters
  --params-file my.yaml           several parameters
  --log-level debug

example:
  scene_flow_node --ros-args -r '~/points:=/lidar/points' -p ego_motion.source:=odometry"""


def refuse_options(arguments: list[str], *, has_life_cycle: bool = False) -> None:
    """Answers --help and --version, and refuses what is not between `--ros-args` and `--`.

    Raises:
        SystemExit: In all these cases, with status 2 after a mistake.
    """
    parser = argparse.ArgumentParser(
        prog="scene_flow_lifecycle_node" if has_life_cycle else "scene_flow_node",
        description=_DESCRIPTION + (_LIFE_CYCLE if has_life_cycle else ""),
        epilog=_EPILOG,
        usage="%(prog)s [-h] [--version] [--ros-args ...]",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"mnsf_ros {__version__}")
    parser.parse_args(_without_ros_arguments(arguments))


def _without_ros_arguments(arguments: list[str]) -> list[str]:
    """What is not between `--ros-args` and the next `--`, which ends them."""
    own, is_own = [], True
    for word in arguments:
        if word == "--ros-args":
            is_own = False
        elif is_own:
            own.append(word)
        elif word == "--":
            is_own = True
    return own
