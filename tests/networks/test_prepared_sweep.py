# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps prepared once, used as next, current and previous."""

import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from mnsf_ros.errors import SweepError
from mnsf_ros.networks.workbench import PreparedSweep, Workbench
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.kept_points import crop_mask, kept_mask
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

ON_CPU = Settings().changed({"compute.device": "cpu"})
NO_GROUND = ON_CPU.changed({"ground.remove": False})


@pytest.fixture
def sweep(make_scene):
    """A street, and a few points that the crop leaves out."""
    outside = [(500, 0, 0), (-500, 3, 1), (0, 0, 30), (0.1, 0, 0), (1e7, 0, 0), (0, 1e20, -1e20)]
    return Sweep.from_array(np.vstack([outside, make_scene().current]))


def test_points_are_the_kept_ones_on_the_device(sweep, device):
    prepared = PreparedSweep(sweep, ON_CPU.changed({"compute.device": device.type}))
    np.testing.assert_array_equal(prepared.kept, kept_mask(sweep.xyz, ON_CPU))
    np.testing.assert_array_equal(prepared.points.cpu().numpy(), sweep.xyz[prepared.kept])
    assert prepared.points.device.type == prepared.positions.device.type == device.type
    assert prepared.points.dtype == prepared.positions.dtype == torch.float32


def test_points_that_the_caller_has_chosen_are_kept(sweep):
    """Only at these are fields evaluated, and ground is not looked for."""
    chosen = np.arange(len(sweep)) % 3 == 0
    prepared = PreparedSweep(replace(sweep, kept=chosen), ON_CPU)
    expected = chosen & crop_mask(sweep.xyz, ON_CPU.crop)
    np.testing.assert_array_equal(prepared.kept, expected)
    np.testing.assert_array_equal(prepared.positions.numpy(), sweep.xyz[expected])
    flow = prepared.whole(prepared.positions)
    np.testing.assert_array_equal(flow[expected], sweep.xyz[expected])
    assert np.isnan(flow[~expected]).all()


def test_flow_is_asked_for_at_the_nearest_place_among_the_kept_points(sweep):
    prepared = PreparedSweep(sweep, ON_CPU)
    positions, points = prepared.positions.numpy(), prepared.points.numpy()
    np.testing.assert_array_equal(positions[prepared.kept], points)
    np.testing.assert_array_equal(positions, np.clip(sweep.xyz, points.min(0), points.max(0)))


def ring(num_points, radius_m=10.0):
    angles = np.linspace(0, 2 * np.pi, num_points, endpoint=False)
    return radius_m * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)


@pytest.mark.parametrize(
    ("points", "left"),
    [
        (np.zeros((0, 3)), "0 of 0"),
        (ring(5000, 200.0), "0 of 5000"),
        (np.vstack([ring(9), ring(50, 1e7), ring(50, 1e20)]), "9 of 109"),
    ],
    ids=["empty", "all beyond the crop", "nearly all beyond the crop"],
)
def test_too_few_points(points, left):
    text = f"sweep at 1.700 s: {left} points are left after crop and ground removal, expected at "
    with pytest.raises(SweepError, match=f"^{re.escape(text)}least 10$"):
        PreparedSweep(Sweep.from_array(points, stamp_ns=1_700_000_000), NO_GROUND)
    assert PreparedSweep(Sweep.from_array(ring(10)), NO_GROUND).kept.all()


@pytest.fixture
def sweeps():
    return [Sweep.from_array(np.add(ring(20), (0, 0, number))) for number in range(5)]


def test_sweep_is_prepared_once_as_the_triplet_moves_on(sweeps):
    prepared = {}

    def bench(number):
        triplet = SweepTriplet(*sweeps[number : number + 3])
        return Workbench(triplet, NO_GROUND, prepared, num_before=1)

    first = bench(0)
    second = bench(1)
    assert (second.before, second.current) == ([first.current], first.next)
    # A sweep that left the triplet is forgotten.
    assert set(prepared) == set(sweeps[1:4])
