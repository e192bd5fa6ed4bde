"""The real node in its own process, and a node of the tests that talks to it over real DDS."""

from __future__ import annotations

import fcntl
import itertools
import os
import tempfile
from pathlib import Path

import pytest

from mnsf_ros.node.process_environment import prepare_environment

_NUM_DOMAINS = 101


def _reserve_domain():
    """A ROS domain that no other run of these tests uses, and the lock that says so."""
    for offset in itertools.count():
        domain = 1 + (os.getpid() + offset) % _NUM_DOMAINS
        lock = Path(tempfile.gettempdir(), f"mnsf_ros_test_domain_{domain}").open("a")  # noqa: SIM115
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
        else:
            return domain, lock
    raise AssertionError


# Before anything of ROS is imported: it reads these once.
_DOMAIN, _LOCK = _reserve_domain()
os.environ["ROS_DOMAIN_ID"] = str(_DOMAIN)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ["ROS_LOG_DIR"] = tempfile.mkdtemp(prefix="mnsf_ros_test_log_")
for _name in (
    "ROS_NAMESPACE",
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
    "RCUTILS_COLORIZED_OUTPUT",
):
    os.environ.pop(_name, None)
prepare_environment()

pytest.importorskip("rclpy")


@pytest.fixture(scope="session")
def ros():
    """Starts and ends ROS in the process of the tests."""
    import rclpy

    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture(scope="module")
def make_peer(ros):
    """Makes nodes of the tests; they end with the module."""
    from scene_flow_peer import SceneFlowPeer

    peers = []

    def make(**options):
        peers.append(SceneFlowPeer(**options))
        return peers[-1]

    yield make
    for peer in peers:
        peer.close()


@pytest.fixture(scope="module")
def start_node(tmp_path_factory):
    """Starts nodes as a user does; ends with the module those that still run."""
    from scene_flow_process import SceneFlowProcess

    processes = []

    def start(*ros_arguments, **options):
        log = tmp_path_factory.mktemp("node") / "stderr"
        processes.append(SceneFlowProcess(log, ros_arguments, **options))
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
