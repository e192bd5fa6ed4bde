# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The real node in its own process, and a node of the tests that talks to it over real DDS."""

import atexit
import contextlib
import os
import signal
import tempfile
import warnings

import pytest
from ros_domain import reserve_domain

from mnsf_ros.node.environment import prepare_environment

# Before anything of ROS is imported, which reads these once. The lock holds as long as the process.
_DOMAIN, _LOCK = reserve_domain()
_LOGS = tempfile.TemporaryDirectory(prefix="mnsf_ros_test_logs_")
atexit.register(_LOGS.cleanup)
os.environ["ROS_DOMAIN_ID"] = str(_DOMAIN)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ["ROS_LOG_DIR"] = _LOGS.name
for _name in ("ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "RCUTILS_CONSOLE_OUTPUT_FORMAT"):
    os.environ.pop(_name, None)
prepare_environment()

pytest.importorskip("rclpy")
# rclpy loads lark with the first node; from Python 3.11 on it imports deprecated modules.
with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    pytest.importorskip("rosidl_generator_py")


@pytest.fixture(scope="session")
def ros():
    """Starts and ends ROS in the process of the tests."""
    import rclpy

    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture(scope="module")
def start_node(tmp_path_factory):
    """Starts nodes that a test expects to end by themselves; ends those that still run."""
    from node_harness import SceneFlowProcess

    with contextlib.ExitStack() as stack:

        def start(parameters, *ros_arguments, **options):
            log = tmp_path_factory.mktemp("node") / "log"
            process = SceneFlowProcess(log, parameters, ros_arguments, **options)
            stack.callback(process.end)
            return process

        yield start


@contextlib.contextmanager
def _running_nodes(tmp_path_factory):
    """A function that starts a node and returns its peer; at the end all nodes must be well."""
    from node_harness import SceneFlowPeer, SceneFlowProcess

    with contextlib.ExitStack() as stack:
        processes = []

        def run(parameters, *ros_arguments, name, has_life_cycle=False, **peer_options):
            log = tmp_path_factory.mktemp("node") / "log"
            names = ("-r", f"__node:={name.rpartition('/')[2]}", *ros_arguments)
            process = SceneFlowProcess(log, parameters, names, has_life_cycle=has_life_cycle)
            processes.append(process)
            stack.callback(process.end)
            peer = SceneFlowPeer(process, name, **peer_options)
            stack.callback(peer.close)
            return peer

        yield run
        for process in processes:
            process.send_signal(signal.SIGINT)
            assert process.wait() == 0, process.log
            assert "Traceback" not in process.log, process.log


@pytest.fixture(scope="module")
def run_node(ros, tmp_path_factory):
    """Starts nodes that must be well when the module ends; each call returns a node's peer."""
    with _running_nodes(tmp_path_factory) as run:
        yield run


@pytest.fixture(scope="session")
def _peer_of_quick_node(ros, tmp_path_factory):
    from node_harness import QUICK

    with _running_nodes(tmp_path_factory) as run:
        yield run(QUICK, name="/quick")


@pytest.fixture
def peer(_peer_of_quick_node):
    """The other end of a node for all tests that leave it as it was."""
    _peer_of_quick_node.wait_for_node()
    return _peer_of_quick_node


@pytest.fixture(scope="session")
def _peer_of_resting_node(ros, tmp_path_factory):
    from node_harness import QUICK

    with _running_nodes(tmp_path_factory) as run:
        parameters = QUICK | {"node.always_estimate": "false"}
        yield run(parameters, name="/resting", watches=False)


@pytest.fixture
def resting_peer(_peer_of_resting_node):
    """The other end of a node that works only for subscribers, which this peer is not."""
    _peer_of_resting_node.advertise(reliable=True)
    _peer_of_resting_node.wait_for_node()
    _peer_of_resting_node.wait_until_settled()
    yield _peer_of_resting_node
    _peer_of_resting_node.stop_watching()


@pytest.fixture
def drive(ros):
    """Sweeps of moving boxes, in a time of their own: a node starts anew with the first."""
    from synthetic_clouds import Drive

    return Drive()
