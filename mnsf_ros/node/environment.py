# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the node needs around it: ROS, a transport for large clouds, quiet threads."""

from __future__ import annotations

import fcntl
import importlib.util
import os
import shutil
import tempfile
import time
from collections.abc import Mapping, MutableMapping
from contextlib import suppress
from pathlib import Path
from typing import Final

from mnsf_ros.errors import MnsfError

TRANSPORT_PROFILE: Final = Path(__file__).with_name("fastdds.xml")
SEGMENT_BYTES: Final = 24 * 2**20  # of shared memory, as the profile says

# Shared memory of Fast DDS: a segment, and a file that its process holds locked while it lives.
_SEGMENT: Final = "fastrtps_" + 16 * "[0-9a-f]"
_LOCK_SUFFIX: Final = "_el"
# Younger ones may not be locked yet.
_MIN_AGE_S: Final = 60

_PROFILE_VARIABLES: Final = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
# Lets a profile say what readers and writers do, and not only the transport.
_READS_PROFILE: Final = "RMW_FASTRTPS_USE_QOS_FROM_XML"


def prepare_environment(environment: MutableMapping[str, str] = os.environ) -> None:
    """Sets what the user has not set, before ROS and torch are loaded.

    The Fast DDS profile lets clouds of several megabytes through and gives their memory back; the
    OpenMP policy keeps torch's threads from burning the core that the ROS executor needs.
    """
    if not any(environment.get(variable) for variable in _PROFILE_VARIABLES):
        environment[_PROFILE_VARIABLES[0]] = str(TRANSPORT_PROFILE)
    if str(TRANSPORT_PROFILE) in map(environment.get, _PROFILE_VARIABLES):
        environment.setdefault(_READS_PROFILE, "1")
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


def remove_dead_segments(folder: Path = Path("/dev/shm")) -> int:
    """Removes shared memory whose process was killed, which nobody else does; returns the bytes.

    Each kill of a node would take some 25 MB of memory for good, and `/dev/shm` be full at last.
    """
    num_bytes = 0
    for lock in folder.glob(_SEGMENT + _LOCK_SUFFIX):
        # Somebody else may remove it at the same time, or own it.
        with suppress(OSError), lock.open("r+b") as file:
            if time.time() - os.fstat(file.fileno()).st_mtime < _MIN_AGE_S:
                continue
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            segment = lock.with_name(lock.name.removesuffix(_LOCK_SUFFIX))
            with suppress(FileNotFoundError):
                size = segment.stat().st_size
                segment.unlink()
                num_bytes += size
            lock.unlink()
    return num_bytes
