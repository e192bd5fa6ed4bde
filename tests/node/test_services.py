# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`~/reset` and `~/set_enabled`."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import SetBool, Trigger


def test_reset_forgets_the_sweeps(peer, drive):
    sweeps = drive.sweeps(*range(5))
    peer.send(*sweeps[:2])
    formed = peer.count("triplets_formed")
    response = peer.call(Trigger, "reset", Trigger.Request())
    assert response.success
    assert response.message
    peer.send(sweeps[2], sweeps[3])
    assert peer.count("triplets_formed") == formed
    peer.send(sweeps[4])
    peer.flow_of(sweeps[3])
    peer.wait_until_settled()
    assert peer.values("flow")["start"] == "cold: first triplet"


def test_a_disabled_node_takes_no_cloud_and_says_so(peer, drive):
    assert peer.call(SetBool, "set_enabled", SetBool.Request(data=False)).success
    peer.spin_until(lambda: "disabled" in peer.status("flow").message, "diagnostics to say so")
    before = peer.num_clouds
    for sweep in drive.sweeps(*range(5)):
        peer.publish(sweep)
    peer.wait_for_diagnostics()
    assert peer.num_clouds == before
    for part in ("input", "flow", "ego motion"):
        assert peer.status(part).level == DiagnosticStatus.OK
        assert "set_enabled" in peer.status(part).message
    assert peer.call(SetBool, "set_enabled", SetBool.Request(data=True)).success
    peer.spin_until(lambda: "disabled" not in peer.status("flow").message, "diagnostics")
    sweeps = drive.sweeps(*range(3))
    peer.send(*sweeps)
    peer.flow_of(sweeps[1])
