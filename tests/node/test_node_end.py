# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Signals in the middle of work: the node ends in order, whatever it is doing."""

from __future__ import annotations

import itertools
import signal
import threading
import time

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from scene_flow_process import ENDLESS, LONG_CALLS, QUICK
from synthetic_clouds import Drive, surfaces, xyz_message
from waiting import PATIENCE_S

from mnsf_ros.node.main import spin

_POINTS = "/points_of_all"

# Settings, signals, and the seconds between them.
_ENDS = {
    # As `ros2 launch` and a terminal do together.
    "interrupted_twice": (ENDLESS, [signal.SIGINT] * 2, 0.1),
    "terminated_impatiently": (ENDLESS, [signal.SIGTERM, signal.SIGINT, signal.SIGTERM], 0),
    "in_a_library_call": (LONG_CALLS, [signal.SIGINT] * 3, 0),
}


@pytest.fixture(scope="module")
def busy_nodes(start_node, make_peer):
    """A node for each test, started all together, their peers, and what sends all a sweep."""
    remapping = ("-r", f"~/points:={_POINTS}")
    processes = {
        name: start_node(settings, *remapping, "-r", f"__node:={name}")
        for name, (settings, _, _) in _ENDS.items()
    }
    peers = {
        name: make_peer(process, node_name=f"/{name}", points=_POINTS, reliable=None)
        for name, process in processes.items()
    }
    lidar = next(iter(peers.values()))
    lidar.advertise(reliable=True)
    for peer in peers.values():
        peer.spin_until(
            lambda peer=peer: peer.values("input").get("reliability") == "reliable", "all nodes"
        )
    sweeps = map(Drive().sweep, itertools.count())
    return processes, peers, lambda: lidar.publish(next(sweeps))


@pytest.mark.parametrize("name", _ENDS)
def test_a_signal_in_the_middle_of_an_estimate(busy_nodes, name):
    processes, peers, send_sweep = busy_nodes
    process, peer = processes[name], peers[name]
    _, numbers, pause_s = _ENDS[name]

    def is_busy():
        send_sweep()
        return peer.values("flow")["busy"] == "True"

    peer.spin_until(is_busy, "an estimate")
    for number in numbers:
        process.send_signal(number)
        time.sleep(pause_s)
    assert process.wait() == 0
    assert "Traceback" not in process.log
    assert "ERROR" not in process.log


def test_a_signal_while_flow_after_flow_is_published(start_node, make_peer):
    """ROS goes away under the worker thread, at any point of its work."""
    process = start_node(QUICK)
    peer = make_peer(process)
    peer.wait_for_node()
    drive, indices = Drive(), itertools.count()

    def has_gone_on():
        index = next(indices)
        # The boxes go to and fro, so that they stay in sight.
        xyz = surfaces(abs(index % 20 - 10), num_points=60)
        peer.publish(xyz_message(xyz, stamp_ns=drive.stamp_ns(index)))
        return len(peer.flows) > 20

    peer.spin_until(has_gone_on, "flow after flow")
    process.send_signal(signal.SIGTERM)
    for _ in range(100):
        has_gone_on()
        time.sleep(0.002)
    assert process.wait() == 0
    assert "Traceback" not in process.log
    assert "ERROR" not in process.log


def test_a_node_without_timers_ends_when_nothing_wakes_it():
    context = Context()
    rclpy.init(args=[], context=context, signal_handler_options=rclpy.SignalHandlerOptions.NO)
    node = rclpy.create_node("without_timers", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    spinning = threading.Thread(target=spin, args=(executor, node), daemon=True)
    spinning.start()
    # It waits by now, or does so a little later and sees that it has to end.
    time.sleep(0.5)
    # As rclpy does it on a signal, after it has woken the executor.
    context.handle.shutdown()
    spinning.join(PATIENCE_S)
    assert not spinning.is_alive()
