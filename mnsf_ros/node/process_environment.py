"""Environment variables that must be set before ROS and torch are loaded."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import MutableMapping
from pathlib import Path

from mnsf_ros.errors import MnsfError

TRANSPORT_PROFILE = Path(__file__).with_name("fastdds.xml")

_PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def prepare_environment(environment: MutableMapping[str, str] = os.environ) -> None:
    """Sets what the user has not set.

    The Fast DDS profile lets clouds of several megabytes through; the OpenMP policy keeps torch's
    threads from burning the core that the ROS executor needs.
    """
    if not any(environment.get(variable) for variable in _PROFILE_VARIABLES):
        environment[_PROFILE_VARIABLES[0]] = str(TRANSPORT_PROFILE)
    environment.setdefault("OMP_WAIT_POLICY", "PASSIVE")


class NoRosError(MnsfError):
    """There is no rclpy in this Python."""


def require_ros() -> None:
    """Checks that rclpy can be imported.

    Raises:
        NoRosError: If not; it says what to do.
    """
    if importlib.util.find_spec("rclpy") is None:
        raise NoRosError(
            "there is no rclpy: source your ROS 2 (source /opt/ros/jazzy/setup.bash), or install "
            "its wheels (pip install 'mnsf_ros[wheels]')"
        )
