# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest


def wait_until_gone(peer):
    peer.stop_advertising()
    peer.spin_until(lambda: peer.values("input")["publishers"] == "0", "the publisher to be gone")


def assert_flow_comes(peer, drive):
    sweeps = drive.sweeps(0, 1, 2)
    peer.send(*sweeps)
    peer.flow_of(sweeps[1])


@pytest.mark.parametrize("first", [False, True], ids=["best effort first", "reliable first"])
@pytest.mark.parametrize("second", [False, True], ids=["best effort", "reliable"])
def test_the_subscription_follows_a_publisher_that_comes_back(peer, drive, first, second):
    for reliable in (first, second):
        wait_until_gone(peer)
        peer.advertise(reliable=reliable)
        peer.wait_for_node("reliable" if reliable else "best_effort")
    assert_flow_comes(peer, drive)


def test_a_best_effort_publisher_after_a_reliable_one_is_heard_at_once(peer, quick_node):
    """No warning of an incompatible subscription, which would be gone a moment later."""
    before = quick_node.log.count("incompatible QoS")
    for reliable in (True, False):
        wait_until_gone(peer)
        peer.spin_until(
            lambda: peer.values("input")["reliability"] == "best_effort", "the way back"
        )
        peer.advertise(reliable=reliable)
        peer.wait_for_node()
    assert quick_node.log.count("incompatible QoS") == before


def test_among_publishers_of_both_kinds_all_are_heard(peer, make_peer, quick_node, drive):
    peer.advertise(reliable=True)
    peer.wait_for_node()
    other = make_peer(quick_node, node_name="/quick", reliable=False, watches=False)
    expected = {"publishers": "2", "reliability": "best_effort"}
    peer.spin_until(lambda: expected.items() <= peer.values("input").items(), f"{expected}")
    sweeps = drive.sweeps(0, 1, 2)
    other.spin_until(lambda: other.diagnostics, "diagnostics")
    for sender, sweep in zip((peer, other, peer), sweeps, strict=True):
        sender.wait_for_subscription("best_effort")
        sender.send(sweep)
        peer.wait_for_diagnostics()
    peer.flow_of(sweeps[1])
    other.stop_advertising()
    peer.wait_for_node()
