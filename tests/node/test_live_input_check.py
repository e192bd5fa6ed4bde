# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What begins to be wrong with the input is on /diagnostics at once, whatever their period."""

import time

from diagnostic_msgs.msg import DiagnosticStatus
from node_harness import QUICK

NUM_GOOD = 30
# A lidar that is faster than most, but not than the node.
INTERVAL_S = 0.05


def stamped(message, stamp_ns):
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    return message


def test_a_frozen_driver_is_told_at_once(run_node, drive):
    peer = run_node(QUICK | {"node.diagnostics_period_s": 60.0}, name="/seldom")
    peer.wait_for_subscription("reliable")
    for number in range(NUM_GOOD + 3):
        last = drive.sweep(min(number, NUM_GOOD))
        peer.publish(stamped(last, drive.stamp_ns(number)))
        peer.spin_for(INTERVAL_S)
    peer.publish(stamped(last, drive.stamp_ns(NUM_GOOD + 3)))
    peer.spin_until(lambda: peer.diagnostics, "diagnostics")
    status = peer.status("input check")
    assert status.level == DiagnosticStatus.ERROR
    assert status.message.startswith("the points are those of an earlier cloud under a new stamp")


def test_stamps_of_another_clock_are_told(peer, drive):
    for number in range(NUM_GOOD):
        peer.send(stamped(drive.sweep(number), time.time_ns() - 5 * 10**9))
    peer.wait_for_diagnostics()
    # Other tests have left more to say.
    assert peer.status("input check").level == DiagnosticStatus.ERROR
    found = peer.values("input check")["lidar and computer have the same time"]
    assert "behind the clock of the computer" in found
