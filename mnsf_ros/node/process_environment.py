"""Environment variables that must be set before ROS and torch are loaded."""

from __future__ import annotations

import os
from collections.abc import MutableMapping
from pathlib import Path

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
