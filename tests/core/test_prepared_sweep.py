# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps made ready once, used as next, current and previous."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from mnsf_ros.core.prepared_sweep import PreparedSweep, SweepPreparation
from mnsf_ros.errors import SweepError
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.ground import ground_mask
from mnsf_ros.sweeps.kept_points import crop_mask
from mnsf_ros.sweeps.sweep import Sweep

ON_CPU = Settings().changed({"compute.device": "cpu"})
NO_GROUND = ON_CPU.changed({"ground.remove": False})


@pytest.fixture
def sweep(make_scene):
    """A street, and a few points that the crop leaves out."""
    outside = [(500, 0, 0), (-500, 3, 1), (0, 0, 30), (0.1, 0, 0), (1e7, 0, 0), (0, 1e20, -1e20)]
    return Sweep.from_array(np.vstack([outside, make_scene().current]))


def test_kept_points_are_inside_the_crop_and_no_ground(sweep):
    prepared = PreparedSweep(sweep, ON_CPU)
    inside = crop_mask(sweep.xyz, ON_CPU.crop)
    ground = np.zeros(len(sweep), bool)
    ground[inside] = ground_mask(sweep.xyz[inside], ON_CPU.ground)
    assert 0 < ground.sum() < inside.sum() < len(sweep)
    np.testing.assert_array_equal(prepared.kept, inside & ~ground)
    np.testing.assert_array_equal(prepared.points.numpy(), sweep.xyz[prepared.kept])


def test_ground_may_stay(sweep):
    kept = PreparedSweep(sweep, NO_GROUND).kept
    np.testing.assert_array_equal(kept, crop_mask(sweep.xyz, NO_GROUND.crop))


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


def test_points_beyond_the_crop_cannot_hide_ground(sweep):
    # A point at 10,000 km would leave the ground map with a single cell for the whole street.
    near = Sweep.from_array(sweep.xyz[6:])
    np.testing.assert_array_equal(
        PreparedSweep(sweep, ON_CPU).kept[6:], PreparedSweep(near, ON_CPU).kept
    )


def test_device(sweep, device):
    settings = ON_CPU.changed({"compute.device": device.type})
    prepared = PreparedSweep(sweep, settings)
    assert prepared.points.device.type == prepared.positions.device.type == device.type
    assert prepared.points.dtype == prepared.positions.dtype == torch.float32


def test_flow_is_asked_for_at_the_nearest_place_among_the_kept_points(sweep):
    prepared = PreparedSweep(sweep, ON_CPU)
    positions, points = prepared.positions.numpy(), prepared.points.numpy()
    assert positions.shape == (len(sweep), 3)
    np.testing.assert_array_equal(positions[prepared.kept], points)
    low, high = points.min(axis=0), points.max(axis=0)
    np.testing.assert_array_equal(positions, np.clip(sweep.xyz, low, high))
    assert positions[0, 0] == high[0]


def test_sweep_is_not_written_to(sweep):
    before = sweep.xyz.copy()
    sweep.xyz.setflags(write=False)
    prepared = PreparedSweep(sweep, ON_CPU)
    prepared.points.zero_()
    prepared.positions.zero_()
    np.testing.assert_array_equal(sweep.xyz, before)


def ring(num_points, radius_m=10.0):
    angles = np.linspace(0, 2 * np.pi, num_points, endpoint=False)
    points = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    return radius_m * points


@pytest.mark.parametrize(
    ("points", "left"),
    [
        (np.zeros((0, 3)), "0 of 0"),
        (ring(1), "1 of 1"),
        (ring(9), "9 of 9"),
        (ring(5000, 200.0), "0 of 5000"),
        (np.vstack([ring(9), ring(50, 1e7), ring(50, 1e20)]), "9 of 109"),
    ],
    ids=["empty", "one", "nine", "all beyond the crop", "nearly all beyond the crop"],
)
def test_too_few_points(points, left):
    text = f"sweep 1700: {left} points are left after crop and ground removal, expected at least 10"
    with pytest.raises(SweepError, match=f"^{re.escape(text)}$"):
        PreparedSweep(Sweep.from_array(points, stamp_ns=1700), NO_GROUND)


def test_too_few_points_are_chosen():
    points = ring(50)
    sweep = Sweep(points.astype(np.float32), kept=np.arange(50) < 5)
    text = "5 of 50 points are left after crop, ground removal and the choice of points, expected"
    with pytest.raises(SweepError, match=text):
        PreparedSweep(sweep, NO_GROUND)


def test_nothing_but_ground():
    plane = np.stack(np.meshgrid(np.arange(30), np.arange(30), 0), axis=-1).reshape(-1, 3)
    with pytest.raises(SweepError, match=r"^sweep 0: 0 of 900 points are left"):
        PreparedSweep(Sweep.from_array(plane), ON_CPU)


def test_ten_points_are_enough():
    assert PreparedSweep(Sweep.from_array(ring(10)), NO_GROUND).kept.all()


@pytest.fixture
def sweeps():
    return [Sweep.from_array(np.add(ring(20), (0, 0, number))) for number in range(5)]


def test_sweep_is_prepared_once_as_the_triplet_moves_on(sweeps):
    preparation = SweepPreparation(NO_GROUND)
    _, current, newest = preparation.prepare(*sweeps[0:3])
    distance = newest.distance
    assert preparation.prepare(*sweeps[1:4])[:2] == [current, newest]
    assert preparation.prepare(*sweeps[2:5])[0].distance is distance


def test_distance_is_built_once(sweeps):
    (prepared,) = SweepPreparation(NO_GROUND).prepare(sweeps[0])
    assert prepared.distance is prepared.distance


def test_sweep_that_left_the_triplet_is_forgotten(sweeps):
    preparation = SweepPreparation(NO_GROUND)
    (first,) = preparation.prepare(sweeps[0])
    preparation.prepare(sweeps[1])
    (again,) = preparation.prepare(sweeps[0])
    assert again is not first


def test_same_sweep_twice_is_prepared_once(sweeps):
    first, second = SweepPreparation(NO_GROUND).prepare(sweeps[0], sweeps[0])
    assert first is second


def test_sweeps_are_told_apart_by_identity_not_by_stamp():
    low, high = Sweep.from_array(ring(20)), Sweep.from_array(ring(30))
    prepared = SweepPreparation(NO_GROUND).prepare(low, high, low)
    assert [len(each.points) for each in prepared] == [20, 30, 20]


def test_refused_sweep_does_not_spoil_the_others(sweeps):
    preparation = SweepPreparation(NO_GROUND)
    first, second = preparation.prepare(*sweeps[:2])
    with pytest.raises(SweepError):
        preparation.prepare(sweeps[1], Sweep.from_array(np.zeros((0, 3))))
    assert preparation.prepare(*sweeps[:2]) == [first, second]


def test_networks_are_evaluated_once_for_each_cell(sweep):
    settings = NO_GROUND.changed({"field.cell_size_m": 0.5})
    prepared = PreparedSweep(sweep, settings)
    seen = []

    def flow_at(rows):
        seen.append(len(rows))
        return rows.clone()

    flow = prepared.everywhere(flow_at, prepared.positions)
    (number,) = seen
    assert 10 < number < len(sweep)
    assert len(flow.unique(dim=0)) == number
    # Nowhere is the one that was looked at out of the cell.
    assert (flow - prepared.positions).abs().max() <= 0.5
    at_each = PreparedSweep(sweep, NO_GROUND).everywhere(flow_at, prepared.positions)
    assert torch.equal(at_each, prepared.positions)


def test_cells_that_are_far_too_small(sweep):
    prepared = PreparedSweep(sweep, NO_GROUND.changed({"field.cell_size_m": 1e-12}))
    flow = prepared.everywhere(torch.clone, prepared.positions)
    assert (flow - prepared.positions).abs().max() <= 0.001


@pytest.mark.parametrize("cell_size_m", [0.0, 0.5])
@pytest.mark.parametrize("removed", [False, True])
def test_what_fields_are_not_fitted_to_may_be_static(sweep, removed, cell_size_m):
    settings = ON_CPU.changed(
        {
            "field.rest_is_static": True,
            "field.cell_size_m": cell_size_m,
            "ego_motion.removed": removed,
        }
    )
    prepared = PreparedSweep(sweep, settings)
    flow = prepared.whole(prepared.everywhere(lambda rows: rows + 1000.0, prepared.positions))
    assert flow[prepared.kept].all()
    assert flow[~prepared.kept].any() != removed
