# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Ego motion and flow on real recordings. Skips where they are absent."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from mnsf_ros.ego_motion.ego_motion import EgoMotion, EgoSource
from mnsf_ros.geometry.rigid_motion import rigid_flow
from mnsf_ros.methods import make_method
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

DATA = Path(os.environ.get("MNSF_DATA", Path(__file__).parents[3] / "shared" / "data"))
SETTINGS = Settings().changed({"compute.device": "cpu"})

# The targets of the project, metres.
MAX_EGO_ERROR_M = 0.02
MAX_STATIC_M = 0.02
MAX_DYNAMIC_M = 0.1
# What is known of earlier triplets takes that long to be of use.
NUM_FIRST = 3


def recorded(name):
    files = sorted((DATA / name).glob("sweep_*.npz"))
    if not files:
        pytest.skip(f"the recording {name} is not here")
    return [np.load(file) for file in files]


def as_sweep(arrays):
    return Sweep(arrays["xyz"], int(arrays["stamp_ns"]), "lidar")


@pytest.mark.parametrize("name", ["kitti_0005", "apollo_arz034", "nebula_vls128"])
def test_ego_motion_is_within_two_centimetres_a_sweep(name):
    ego_motion, found, true = EgoMotion(SETTINGS.ego_motion), [], []
    for arrays in recorded(name):
        pose = ego_motion.pose_of(as_sweep(arrays))
        found.append(pose)
        true.append(arrays["pose"])
    assert {item.source for item in found[1:]} == {EgoSource.REGISTRATION}
    errors_m = []
    for index in range(1, len(found)):
        step = np.linalg.inv(found[index - 1].world_from_sensor) @ found[index].world_from_sensor
        true_step = np.linalg.inv(true[index - 1]) @ true[index]
        errors_m.append(np.linalg.norm(step[:3, 3] - true_step[:3, 3]))
    assert np.mean(errors_m) < MAX_EGO_ERROR_M


def test_flow_of_labelled_points():
    """Both halves of the target: what stands, and what moves beside ego motion only."""
    frames = recorded("kitti_0005")
    sweeps = [as_sweep(arrays) for arrays in frames]
    estimator = make_method("online", SETTINGS)
    static_m, dynamic_m, ego_only_m = [], [], []
    for index in range(1, len(sweeps) - 1):
        result = estimator.estimate(SweepTriplet(*sweeps[index - 1 : index + 2]))
        arrays = frames[index]
        scored = arrays["label_valid"] & arrays["flow_valid"] & ~arrays["is_ground"]
        if index <= NUM_FIRST or not scored.any():
            continue
        ego_flow = rigid_flow(arrays["xyz"], result.over_ground.next_from_current)
        is_dynamic = arrays["is_dynamic"][scored]
        errors_m, ego_errors_m = (
            np.linalg.norm(flow[scored] - arrays["flow"][scored], axis=1)
            for flow in (result.flow, ego_flow)
        )
        static_m.append(errors_m[~is_dynamic].mean())
        if is_dynamic.any():
            dynamic_m.append(errors_m[is_dynamic].mean())
            ego_only_m.append(ego_errors_m[is_dynamic].mean())
    assert np.mean(static_m) <= MAX_STATIC_M
    assert np.mean(dynamic_m) <= MAX_DYNAMIC_M
    assert np.mean(dynamic_m) <= 0.5 * np.mean(ego_only_m)
