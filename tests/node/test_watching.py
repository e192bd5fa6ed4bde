# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Nothing is estimated while nobody wants it."""

from __future__ import annotations

import itertools


def send_until_it_rests(peer, drive):
    """Goes on with the drive until the node knows that nobody subscribes."""
    before = peer.count("triplets_unwatched")
    sweeps = map(drive.sweep, itertools.count(100))
    peer.send_until(sweeps, lambda: peer.count("triplets_unwatched") > before, "rest")
    peer.wait_until_settled()


def test_without_a_subscriber_nothing_is_estimated(resting_peer, drive):
    send_until_it_rests(resting_peer, drive)
    before, flows_out = resting_peer.count("triplets_unwatched"), resting_peer.count("flows_out")
    resting_peer.send(*drive.sweeps(*range(5)))
    assert resting_peer.count("triplets_unwatched") == before + 3
    assert resting_peer.count("flows_out") == flows_out
    assert resting_peer.values("flow")["busy"] == "False"
    # The diagnostics after one of the sweeps say so; not each of them is received.
    said = "resting: nobody subscribes to the flow"
    sweeps = map(drive.sweep, itertools.count(5))
    resting_peer.send_until(
        sweeps, lambda: resting_peer.status("flow").message == said, "the reason"
    )


def test_work_begins_with_a_subscriber_and_ends_with_it(resting_peer, drive):
    resting_peer.watch()
    sweeps = map(drive.sweep, itertools.count(50))
    resting_peer.send_until(sweeps, lambda: resting_peer.flows, "the first flow")
    resting_peer.stop_watching()
    send_until_it_rests(resting_peer, drive)
    flows_out = resting_peer.count("flows_out")
    resting_peer.send(*drive.sweeps(*range(5)))
    assert resting_peer.count("flows_out") == flows_out


def test_with_always_estimate_no_subscriber_is_needed(resting_peer, drive):
    assert resting_peer.set({"node.always_estimate": True})[0].successful
    flows_out = resting_peer.count("flows_out")
    resting_peer.send(*drive.sweeps(*range(3)))
    resting_peer.spin_until(lambda: resting_peer.count("flows_out") > flows_out, "an estimate")
    assert resting_peer.set({"node.always_estimate": False})[0].successful
    resting_peer.wait_until_settled()
    unwatched = resting_peer.count("triplets_unwatched")
    resting_peer.send(drive.sweep(3))
    assert resting_peer.count("triplets_unwatched") == unwatched + 1
