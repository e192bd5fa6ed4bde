# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The node with config/mnsf.yaml: networks that live from cloud to cloud."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from box_street import BoxStreet, pose
from node_harness import QUICK
from synthetic_clouds import column, flow_columns, xyz_message

CONFIG = Path(__file__).resolve().parents[2] / "config" / "mnsf.yaml"
NUM_CAR_POINTS = 400


@pytest.mark.slow
def test_flow_of_networks_from_a_warm_start(run_node, drive):
    own = {"ground.remove": "true", "objects.cell_size_m": 0.25}
    peer = run_node(QUICK | own, "--params-file", str(CONFIG), name="/networks")
    peer.wait_for_node()
    street, sweeps = BoxStreet(), []
    for index in range(6):
        xyz = street.xyz(pose(), index, cars=[(8.0 + 0.8 * index, -2.0)])
        sweeps.append(xyz_message(xyz, stamp_ns=drive.stamp_ns(index)))
    # Each flow before the next cloud: none is dropped.
    peer.send(*sweeps[:2])
    for current, newest in pairwise(sweeps[1:]):
        peer.send(newest)
        message = peer.flow_of(current)
    flow = flow_columns(message)
    is_high = column(message, "z") > -1.4
    car = is_high & (np.arange(len(flow)) >= len(flow) - NUM_CAR_POINTS)
    np.testing.assert_allclose(flow[car], np.tile((0.8, 0, 0), (car.sum(), 1)), atol=0.1)
    assert (column(message, "dynamic")[car] == 1).all()
    assert np.isfinite(flow).all()
    np.testing.assert_allclose(flow[:-NUM_CAR_POINTS], 0, atol=0.02)
    peer.wait_until_settled()
    values = peer.values("flow")
    assert values["start"] == "warm"
    for stage in ("forward", "backward", "fusion"):
        assert float(values[f"{stage} median [ms]"]) > 0
        assert values[f"{stage} stop reason"] == "iteration_limit"
    assert peer.get("live.enabled") is True
