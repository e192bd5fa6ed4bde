# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Signals at any time: the node ends in order, whatever it is doing."""

import itertools
import signal
import threading
import time

import pytest
import rclpy
from moving_boxes import surfaces
from node_harness import ENDLESS, LONG_CALLS, PATIENCE_S, QUICK
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from synthetic_clouds import Drive, xyz_message

from mnsf_ros.node.__main__ import spin

# Settings, signals, and the seconds between them.
_ENDS = {
    # As `ros2 launch` and a terminal do together.
    "interrupted_twice": (ENDLESS, [signal.SIGINT] * 2, 0.1),
    "terminated_impatiently": (ENDLESS, [signal.SIGTERM, signal.SIGINT, signal.SIGTERM], 0),
    "in_a_library_call": (LONG_CALLS, [signal.SIGINT] * 3, 0),
}


def assert_ended_in_order(process):
    assert process.wait() == 0
    assert "Traceback" not in process.log
    assert "ERROR" not in process.log


@pytest.mark.slow
@pytest.mark.parametrize("name", _ENDS)
def test_a_signal_in_the_middle_of_an_estimate(run_node, name):
    settings, numbers, pause_s = _ENDS[name]
    peer = run_node(settings, name=f"/{name}")
    peer.wait_for_node()
    sweeps = map(Drive().sweep, itertools.count())

    def is_busy():
        peer.publish(next(sweeps))
        return peer.values("flow")["busy"] == "True"

    peer.spin_until(is_busy, "an estimate")
    for number in numbers:
        peer.process.send_signal(number)
        time.sleep(pause_s)
    assert_ended_in_order(peer.process)


def test_a_signal_while_flow_after_flow_is_published(run_node):
    """ROS goes away under the worker thread, at any point of its work."""
    peer = run_node(QUICK, name="/publishing")
    peer.wait_for_node()
    drive, indices = Drive(), itertools.count()

    def has_gone_on():
        index = next(indices)
        # The boxes go to and fro, so that they stay in sight.
        xyz = surfaces(abs(index % 20 - 10), num_points=60)
        peer.publish(xyz_message(xyz, stamp_ns=drive.stamp_ns(index)))
        return len(peer.flows) > 20

    peer.spin_until(has_gone_on, "flow after flow")
    peer.process.send_signal(signal.SIGTERM)
    for _ in range(100):
        has_gone_on()
        time.sleep(0.002)
    assert_ended_in_order(peer.process)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("library", ["_multiarray_umath", "libfastrtps"])
def test_a_signal_while_libraries_are_loaded(start_node, number, library):
    process = start_node({})
    give_up = time.monotonic() + PATIENCE_S
    while not process.has_loaded(library):
        assert time.monotonic() < give_up
    process.send_signal(number)
    assert_ended_in_order(process)


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
