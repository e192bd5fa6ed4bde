# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Flow and diagnostics on simulated time, with and without a clock."""

from __future__ import annotations

import pytest
from rosgraph_msgs.msg import Clock
from scene_flow_peer import stamp_of


@pytest.fixture(autouse=True)
def sim_time(peer):
    """The node runs on simulated time for a test."""
    assert peer.set({"use_sim_time": True})[0].successful
    yield
    assert peer.set({"use_sim_time": False})[0].successful


@pytest.fixture
def set_clock(peer):
    """Publishes the simulated time until the node has it."""
    publisher = peer.node.create_publisher(Clock, "/clock", 1)

    def set_to(stamp_ns):
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(stamp_ns, 10**9)

        def has_arrived():
            publisher.publish(message)
            return diagnostics_stamp_ns(peer) == stamp_ns

        peer.spin_until(has_arrived, f"the time {stamp_ns}")

    yield set_to
    peer.node.destroy_publisher(publisher)


def diagnostics_stamp_ns(peer):
    header = peer.diagnostics[-1]["header"]
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def test_before_the_first_clock_there_are_diagnostics_and_flow(peer, drive):
    peer.spin_until(lambda: diagnostics_stamp_ns(peer) == 0, "diagnostics without a time")
    peer.wait_for_diagnostics()
    sweeps = drive.sweeps(0, 1, 2)
    peer.send(*sweeps)
    peer.flow_of(sweeps[1])
    assert peer.status("input").level == b"\x00"
    before = peer.count("sweeps_duplicate")
    peer.send(*(drive.sweep(index, stamp_ns=0) for index in range(3)))
    assert peer.count("sweeps_duplicate") == before + 2


def test_with_a_clock_there_are_diagnostics_and_flow_until_it_jumps_back(peer, drive, set_clock):
    sweeps = drive.sweeps(0, 1, 2)
    for sweep in sweeps:
        set_clock(stamp_of(sweep))
        peer.send(sweep)
    peer.flow_of(sweeps[1])
    assert diagnostics_stamp_ns(peer) == stamp_of(sweeps[2])
    set_clock(10**9)
    sweeps = drive.sweeps(3, 4, 5)
    peer.send(*sweeps)
    peer.flow_of(sweeps[1])


def test_with_a_clock_sweeps_without_a_stamp_take_its_time(peer, drive, set_clock):
    for index in range(3):
        set_clock(drive.stamp_ns(index))
        peer.send(drive.sweep(index, stamp_ns=0))
    peer.spin_until(lambda: 0 in peer.flows, "the flow")
