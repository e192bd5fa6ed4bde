# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Networks in a world that stands still: the sensor's own motion is found first."""

import numpy as np
import pytest
import torch
from box_street import BoxStreet, pose

from mnsf_ros.ego_motion.ego_motion import EgoSource
from mnsf_ros.geometry.rigid_motion import rigid_flow, transformed
from mnsf_ros.methods import make_method
from mnsf_ros.methods.network_estimator import NetworkEstimator, NetworkMethod
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

STREET = BoxStreet()
QUICK = preset("paper").changed(
    {
        "ego_motion.removed": True,
        "compute.num_threads": 1,
        "compute.device": "cpu",
        "distance.kind": "tree",
        "field.num_hidden_layers": 3,
        "field.hidden_width": 32,
        "fusion.hidden_width": 16,
        "optimization.max_iterations": 40,
        "fusion.max_iterations": 20,
    }
)


def path(index):
    """Two metres a sweep in a curve: networks of this size do not find that within 40 steps."""
    return pose(2.0 * index, 0.1 * index, yaw_deg=2.0 * index)


def car_at(index):
    """A car that drives 0.3 m a sweep over ground."""
    return 12.0 + 0.3 * index, -2.0


def sweep_at(index, **how):
    return STREET.sweep(path(index), index, cars=[car_at(index)], **how)


def triplet_at(index, **how):
    return SweepTriplet(*(sweep_at(number, **how) for number in (index - 1, index, index + 1)))


@pytest.fixture(scope="module")
def triplet():
    return triplet_at(1)


@pytest.fixture(scope="module")
def estimate(triplet):
    return make_method("mnsf", QUICK).estimate(triplet)


def next_from_current(index):
    return np.linalg.inv(path(index + 1)) @ path(index)


def test_flow_of_what_stands_is_that_of_the_sensor(triplet, estimate):
    standing = rigid_flow(triplet.current.xyz, next_from_current(1))
    errors = np.linalg.norm(estimate.flow - standing, axis=1)
    assert np.linalg.norm(standing, axis=1).mean() > 1.5
    assert np.median(errors) < 0.05


def test_motion_over_ground_and_flow_belong_together(triplet, estimate):
    known, xyz = estimate.over_ground, triplet.current.xyz
    assert known.source == EgoSource.REGISTRATION.value
    stages = {"ego motion", "prepare", "forward", "backward", "fusion"}
    assert stages <= estimate.times_ms.keys()
    assert np.allclose(known.next_from_current, next_from_current(1), atol=0.02)
    turn, shift = known.next_from_current[:3, :3], known.next_from_current[:3, 3]
    moved = (xyz + known.motion) @ turn.T + shift
    assert np.allclose(xyz + estimate.flow, moved, atol=1e-4)
    lengths = np.linalg.norm(known.motion, axis=1)
    assert np.array_equal(known.dynamic, lengths > 0.05)
    assert np.isnan(known.confidence).all()


def test_odometry_is_taken_where_it_is_wanted():
    settings = QUICK.changed({"ego_motion.source": "odometry"})
    sweeps = [sweep_at(index, odometry=pose(100, 3) @ path(index)) for index in range(3)]
    known = make_method("mnsf", settings).estimate(SweepTriplet(*sweeps)).over_ground
    assert known.source == EgoSource.ODOMETRY.value
    assert np.allclose(known.next_from_current, next_from_current(1), atol=1e-9)


def test_switched_off_and_on_on_the_way(triplet):
    few = {"optimization.max_iterations": 4, "fusion.max_iterations": 4}
    on = QUICK.changed(few)
    off = on.changed({"ego_motion.removed": False})
    estimator = make_method("mnsf", on)
    estimator.estimate(triplet)
    for settings in (off, on):
        estimator = estimator.renewed(settings)
        result = estimator.estimate(triplet)
        expected = make_method("mnsf", settings).estimate(triplet)
        np.testing.assert_array_equal(result.flow, expected.flow)
        assert (result.over_ground is None) == (settings is off)


class KnownFlow:
    """A method that is told the motion over ground, and remembers what it was asked for."""

    settings = QUICK.changed({"ego_motion.source": "odometry", "ground.remove": False})

    def __init__(self, motion=(0.0, 0.0, 0.0, 0.0)):
        self.motion = motion
        self.asked = None

    def __call__(self, bench):
        self.asked = bench.triplet
        flow = torch.zeros_like(bench.current.positions)
        flow[:, 0] = torch.tensor(self.motion).repeat(len(flow) // 4)
        return flow

    def estimate(self, triplet, **how):
        return NetworkEstimator(self.settings, NetworkMethod(self, **how)).estimate(triplet)


def told_sweep(index, interval_s=0.1, odometry=True):
    """40 points and the sensor's pose: 0.5 m a sweep."""
    xyz = np.random.default_rng(index).uniform((-20, -20, 0), (20, 20, 3), (40, 3))
    known = pose(0.5 * index, yaw_deg=3.0 * index) if odometry else None
    stamp_ns = round(index * interval_s * 1e9)
    return Sweep(xyz.astype(np.float32), stamp_ns, "lidar", odometry=known)


# Without stamps the usual interval counts, 0.1 s.
@pytest.mark.parametrize(("interval_s", "limit_m"), [(0.1, 0.05), (0.2, 0.1), (0.0, 0.05)])
def test_who_moves_is_a_matter_of_speed(interval_s, limit_m):
    method = KnownFlow([limit_m * share for share in (0.1, 0.9, 1.1, 3.0)])
    triplet = SweepTriplet(*(told_sweep(index, interval_s) for index in range(3)))
    known = method.estimate(triplet).over_ground
    assert known.dynamic.tolist() == 10 * [False, False, True, True]


def test_method_gets_all_sweeps_in_the_frame_of_the_current_one():
    method = KnownFlow()
    sweeps = [told_sweep(index) for index in range(5)]
    triplet = SweepTriplet(sweeps[2], sweeps[3], sweeps[4], earlier=(sweeps[1], sweeps[0]))
    method.estimate(triplet, num_sweeps=5)
    asked = method.asked
    assert asked.current is sweeps[3]
    current_from_world = np.linalg.inv(sweeps[3].odometry)
    moved = (asked.next, *asked.before)
    for got, sweep in zip(moved, (sweeps[i] for i in (4, 2, 1, 0)), strict=True):
        expected = transformed(sweep.xyz, current_from_world @ sweep.odometry)
        assert np.allclose(got.xyz, expected, atol=1e-4)
        assert got.stamp_ns == sweep.stamp_ns
