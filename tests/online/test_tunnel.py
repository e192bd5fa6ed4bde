# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What goes along with the sensor in a bare tunnel is the pattern of its beams, no mover."""

from __future__ import annotations

import numpy as np
import pytest

from mnsf_ros.online.object_flow import ObjectFlowEstimator
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

HALF_WIDTH_M, FLOOR_M, CEILING_M, REACH_M = 4.0, -1.8, 2.5, 45.0
SPEED_M, NOISE_M, NUM_SWEEPS = 0.9, 0.02, 12


def directions(elevations_deg, num_azimuths=900):
    azimuths = np.linspace(-np.pi, np.pi, num_azimuths, endpoint=False)
    azimuth, elevation = np.meshgrid(azimuths, np.radians(elevations_deg))
    flat = np.cos(elevation)
    ahead, left = flat * np.cos(azimuth), flat * np.sin(azimuth)
    return np.stack([ahead, left, np.sin(elevation)], axis=-1).reshape(-1, 3)


def tunnel_sweep(index, rays):
    """What a lidar sees of a tunnel that has no ends."""
    with np.errstate(divide="ignore"):
        to_wall = HALF_WIDTH_M / np.abs(rays[:, 1])
        to_floor = np.where(rays[:, 2] < 0, FLOOR_M, CEILING_M) / rays[:, 2]
    ranges = np.minimum(to_wall, to_floor)
    ranges += np.random.default_rng(index).normal(0, NOISE_M, len(ranges))
    is_seen = ranges < REACH_M
    xyz = (rays[is_seen] * ranges[is_seen, None]).astype(np.float32)
    odometry = np.eye(4)
    odometry[0, 3] = SPEED_M * index
    return Sweep(xyz, 100_000_000 * index, "lidar", odometry=odometry)


@pytest.mark.parametrize(
    ("elevations_deg", "most"),
    # With places that count as free at a flat angle, and no rule for what goes along: 44 and 15.
    [(np.linspace(-24.8, 2.0, 64), 8), (np.linspace(-15.0, 15.0, 16), 8)],
    ids=["64 beams", "16 beams"],
)
def test_a_bare_tunnel_has_hardly_any_movers(elevations_deg, most):
    rays = directions(elevations_deg)
    sweeps = [tunnel_sweep(index, rays) for index in range(NUM_SWEEPS)]
    settings = Settings().changed({"ego_motion.source": "odometry"})
    estimator, movers = ObjectFlowEstimator(settings), []
    for three in zip(sweeps, sweeps[1:], sweeps[2:], strict=False):
        over_ground = estimator.estimate(SweepTriplet(*three)).over_ground
        movers.append(len(over_ground.objects))
    assert np.mean(movers[3:]) <= most
