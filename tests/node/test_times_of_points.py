# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the node says of the times of points."""

from __future__ import annotations

import numpy as np
from synthetic_clouds import cloud_message, surfaces


def timed(drive, index, times, name="t"):
    """A sweep with a field of times."""
    columns = dict(zip("xyz", surfaces(index).T, strict=True)) | {name: times}
    return cloud_message(columns, stamp_ns=drive.stamp_ns(index))


def test_the_field_is_told_once_and_in_the_diagnostics(peer, drive):
    offsets = np.linspace(0, 99e6, 1200).astype(np.uint32)
    sweeps = [timed(drive, index, offsets) for index in range(3)]
    peer.send(*sweeps)
    peer.flow_of(sweeps[1])
    source = "field 't' (uint32, ns, relative to the stamp)"
    assert peer.values("input")["time of each point"] == source
    assert peer.process.log.count(f"time of each point: {source}") == 1


def test_invalid_times_are_counted_and_cost_no_flow(peer, drive):
    before = peer.count("clouds_without_usable_times")
    sweeps = [timed(drive, index, np.full(1200, 7.0), "timestamp") for index in range(3)]
    peer.send(*sweeps)
    peer.flow_of(sweeps[1])
    assert peer.count("clouds_without_usable_times") == before + 3
    assert peer.values("input")["time of each point"] == "none"
    assert peer.process.log.count("the times of points are not used") == 1
