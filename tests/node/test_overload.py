# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A node that is too slow drops triplets and counts them; nothing queues."""

from __future__ import annotations

import pytest
from scene_flow_process import ENDLESS


@pytest.mark.slow
def test_while_an_estimate_never_ends(run_node, drive):
    peer = run_node(ENDLESS, name="/endless")
    peer.wait_for_node()
    peer.send(*drive.sweeps(0, 1, 2))
    peer.spin_until(lambda: peer.values("flow")["busy"] == "True", "an estimate")
    peer.send(*drive.sweeps(*range(3, 23)))
    peer.wait_for_diagnostics()
    assert peer.count("sweeps_received") == 23
    assert peer.count("triplets_formed") == 21
    # One is estimated, one waits.
    assert peer.count("triplets_dropped") == 19
    assert peer.values("flow")["queue"] == "1"
    messages = {item["flow"].message for item in peer.diagnostics}
    assert "estimating" in messages
    assert any(message.startswith("CPU busy: 0 of ") for message in messages)
    assert not peer.flows
    # Without waiting for the estimate under way, which would take minutes.
    assert peer.set({"optimization.max_iterations": 80})[0].successful
    peer.flow_of(drive.sweep(21))
    peer.wait_until_settled()
    assert peer.count("triplets_abandoned") == 1


def test_a_burst_gives_the_flow_of_its_last_triplet(peer, drive):
    peer.wait_until_settled()
    peer.flows.clear()
    before = peer.count("flows_out")
    sweeps = drive.sweeps(*range(40))
    for sweep in sweeps:
        peer.publish(sweep)
    peer.flow_of(sweeps[-2])
    peer.wait_until_settled()
    assert peer.num_open_triplets == 0
    flows_out = peer.count("flows_out") - before
    peer.spin_until(lambda: len(peer.flows) == flows_out, f"{flows_out} flows")
    assert flows_out < len(sweeps) - 2
