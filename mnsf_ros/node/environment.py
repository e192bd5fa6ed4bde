"""What the node needs around it: ROS, a transport for large clouds, quiet threads."""

from __future__ import annotations

import importlib.util
import os
import shutil
import tempfile
from collections.abc import Mapping, MutableMapping
from pathlib import Path
from typing import Final

from mnsf_ros.errors import MnsfError

TRANSPORT_PROFILE: Final = Path(__file__).with_name("fastdds.xml")
SEGMENT_BYTES: Final = 24 * 2**20  # of shared memory, as the profile says

_PROFILE_VARIABLES: Final = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def prepare_environment(environment: MutableMapping[str, str] = os.environ) -> None:
    """Sets what the user has not set, before ROS and torch are loaded.

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
            "its wheels (in the checkout: pip install '.[wheels]')"
        )


def transport_fault(
    environment: Mapping[str, str] = os.environ, folder: Path = Path("/dev/shm")
) -> str:
    """Returns why clouds do not go through shared memory, and what follows; empty if they do.

    Only of this package's profile for Fast DDS: of other transports nothing is known.
    """
    is_fast_dds = "fastrtps" in environment.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
    profiles = {environment.get(variable) for variable in _PROFILE_VARIABLES}
    if not is_fast_dds or str(TRANSPORT_PROFILE) not in profiles:
        return ""
    fault = _memory_fault(folder)
    if not fault:
        return ""
    return (
        f"no shared memory, {fault}: clouds go through UDP, which loses large ones of best-effort "
        f"publishers. Publish reliable, or make {folder} writable with at least "
        f"{2 * SEGMENT_BYTES >> 20} MiB"
    )


def _memory_fault(folder: Path) -> str:
    try:
        with tempfile.TemporaryFile(dir=folder):
            free_bytes = shutil.disk_usage(folder).free
    except OSError as error:
        return f"{folder}: {error.strerror}"
    if free_bytes < SEGMENT_BYTES:
        return f"{folder} has {free_bytes >> 20} MiB left, {SEGMENT_BYTES >> 20} are needed"
    return ""
