# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""ROS domains of tests: no two processes of tests on a machine share one."""

import atexit
import fcntl
import itertools
import os
import tempfile
from pathlib import Path

_NUM_DOMAINS = 101


def reserve_domain():
    """A free ROS domain, and the open file whose lock reserves it."""
    for offset in itertools.count(os.getpid()):
        domain = 1 + offset % _NUM_DOMAINS
        path = Path(tempfile.gettempdir(), f"mnsf_ros_test_domain_{domain}_{os.getuid()}")
        lock = path.open("w")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            continue
        atexit.register(lock.close)
        return domain, lock
    raise AssertionError
