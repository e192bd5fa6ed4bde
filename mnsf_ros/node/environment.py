# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The node's process: ROS, environment variables, memory, and an end in time."""

import ctypes
import faulthandler
import os
import re
import socket
import sys
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from mnsf_ros.core.compute_device import let_threads_sleep
from mnsf_ros.errors import SettingsError, shortened

# Of a lidar driver, and of the node where sockets cannot hold a cloud.
TRANSPORT_PROFILE: Final = Path(__file__).with_name("fastdds.xml")
UDP_PROFILE: Final = TRANSPORT_PROFILE.with_name("fastdds_udp.xml")
# A usual cloud; Linux allows 0.2 MB unless it is told otherwise.
_CLOUD_BYTES: Final = 4 * 2**20
# As in the profile: several clouds of 128 beams.
_SOCKET_BYTES: Final = 32 * 2**20
_PROFILE_VARIABLES: Final = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
# Makes the ROS layer read the profiles of readers and writers, too.
_READS_PROFILE: Final = "RMW_FASTRTPS_USE_QOS_FROM_XML"
# The ports of a higher domain would be above 65535.
_MAX_DOMAIN: Final = 232

# A participant of Fast DDS that is destroyed while it discovers another one may wait for ever: it
# holds the lock that the discovery needs to end.
END_TIMEOUT_S: Final = 20.0

# Of malloc.h of glibc.
_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
# Clouds and their intermediate arrays are below the first; with every sweep their pages would be
# taken from the system and returned, which costs more than building and sending a cloud.
_MMAP_BYTES: Final = 32 * 2**20
_TRIM_BYTES: Final = 256 * 2**20
# Returning takes some 10 ms. Without it the heap grows for hours, by the memory that the threads of
# the node happen to need at the same time.
RETURN_PERIOD_S: Final = 30.0


def prepare_environment(
    environment: MutableMapping[str, str] = os.environ, *, is_node: bool = False
) -> None:
    """Sets the variables that the user has not set, before ROS and torch are loaded.

    The Fast DDS profile lets clouds of several megabytes through and gives their memory back. The
    node itself hears drivers that have no profile, too.

    Raises:
        SettingsError: If ROS_DOMAIN_ID is no domain of ROS.
    """
    _check_domain(environment.get("ROS_DOMAIN_ID", ""))
    profile = UDP_PROFILE if is_node and sockets_hold_clouds() else TRANSPORT_PROFILE
    given = [name for name in _PROFILE_VARIABLES if environment.get(name)]
    for name in given or _PROFILE_VARIABLES[:1]:
        # A user may have set that of drivers for all programs.
        if environment.get(name) in (None, "", str(TRANSPORT_PROFILE)):
            environment[name] = str(profile)
            environment.setdefault(_READS_PROFILE, "1")
    let_threads_sleep(environment)


def _check_domain(text: str) -> None:
    # ROS takes an empty text for none.
    if text and not (re.fullmatch("[0-9]{1,9}", text) and int(text) <= _MAX_DOMAIN):
        raise SettingsError(
            f"ROS_DOMAIN_ID is {shortened(text)}, expected a whole number from 0 to {_MAX_DOMAIN}: "
            "export another one, or unset it for 0"
        )


def sockets_hold_clouds(num_bytes: int = _CLOUD_BYTES) -> bool:
    """Whether the system allows receive buffers of so many bytes."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, num_bytes)
        return probe.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) >= num_bytes


def advice_on_lost_clouds() -> str:
    """What to do where best-effort clouds are lost between programs; the end of a message."""
    profile = f"start the driver with {_PROFILE_VARIABLES[0]}={TRANSPORT_PROFILE}"
    ways = ["publish reliable", profile]
    if not sockets_hold_clouds(_SOCKET_BYTES):
        sysctl = f"sudo sysctl -w net.core.rmem_max={_SOCKET_BYTES} and start this node again"
        ways = [sysctl, *ways]
    return " or ".join(ways)


def keep_memory() -> None:
    """Raises the thresholds for returning memory, where the system has glibc."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, _MMAP_BYTES)
        mallopt(_M_TRIM_THRESHOLD, _TRIM_BYTES)


def return_memory() -> None:
    """Returns all free memory of the process to the system, where glibc can."""
    malloc_trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if malloc_trim is not None:
        malloc_trim(0)


@contextmanager
def leaving_ros(timeout_s: float = END_TIMEOUT_S) -> Iterator[None]:
    """Ends the process if Fast DDS hangs while a node is destroyed inside.

    The exit status is then 1, and the stacks of all threads are on stderr. The watchdog needs no
    lock of the interpreter, which a library may hold.
    """
    with open(os.devnull, "w") as nowhere:  # noqa: PTH123 - stderr may be closed
        faulthandler.dump_traceback_later(timeout_s, exit=True, file=sys.__stderr__ or nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()
