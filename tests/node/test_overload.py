# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest
from scene_flow_process import ENDLESS


class TestWhileAnEstimateNeverEnds:
    @pytest.fixture(scope="class")
    def peer(self, start_node, make_peer):
        process = start_node(ENDLESS, "-r", "__node:=endless")
        peer = make_peer(process, node_name="/endless")
        peer.wait_for_node()
        yield peer
        assert process.stop() == 0
        assert "Traceback" not in process.log

    @pytest.fixture(scope="class", autouse=True)
    def estimate_under_way(self, peer):
        from synthetic_clouds import Drive

        drive = Drive()
        peer.send(*drive.sweeps(0, 1, 2))
        peer.spin_until(lambda: peer.values("flow")["busy"] == "True", "an estimate")
        return drive

    def test_triplets_are_dropped_and_nothing_queues(self, peer, estimate_under_way):
        peer.send(*estimate_under_way.sweeps(*range(3, 23)))
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

    def test_diagnostics_go_on(self, peer):
        peer.wait_for_diagnostics()
        assert peer.values("flow")["busy"] == "True"

    def test_parameters_can_be_read_and_changed(self, peer):
        """The last test: a change abandons the estimate, a later one that which waited."""
        for index in range(10):
            assert peer.set({"crop.max_range_m": 70.0 + index})[0].successful
            assert peer.get("crop.max_range_m") == 70.0 + index


def test_a_burst_gives_the_flow_of_its_last_triplet(peer, drive):
    peer.flows.clear()
    sweeps = drive.sweeps(*range(40))
    for sweep in sweeps:
        peer.publish(sweep)
    peer.flow_of(sweeps[-2])
    peer.wait_until_settled()
    assert peer.num_open_triplets == 0
    assert len(peer.flows) < len(sweeps) - 2


def test_flow_of_every_triplet_is_accounted_for(peer, drive):
    peer.wait_until_settled()
    before = len(peer.flows), peer.count("flows_out")
    peer.send(*drive.sweeps(*range(30)))
    peer.wait_until_settled()
    flows_out = peer.count("flows_out") - before[1]
    peer.spin_until(lambda: len(peer.flows) - before[0] == flows_out, f"{flows_out} flows")
    assert peer.num_open_triplets == 0


def test_settings_that_are_changed_back_bring_the_flow_back(start_node, make_peer):
    """Without waiting for the estimate under way, which would take minutes."""
    from synthetic_clouds import Drive

    process = start_node(ENDLESS, "-r", "__node:=changed_back")
    peer, drive = make_peer(process, node_name="/changed_back"), Drive()
    peer.wait_for_node()
    peer.send(*drive.sweeps(*range(4)))
    peer.spin_until(lambda: peer.values("flow")["queue"] == "1", "an estimate and one that waits")
    assert peer.set({"optimization.max_iterations": 80})[0].successful
    peer.flow_of(drive.sweep(2))
    peer.wait_until_settled()
    assert peer.count("triplets_abandoned") == 1
    assert process.stop() == 0
