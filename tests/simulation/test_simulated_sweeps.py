# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from slow_geometry import signed_distance

from mnsf_ros.geometry.transforms import apply, invert
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.street import CURB_HEIGHT_M
from mnsf_ros.simulation.sweeps import FIRST_STAMP_NS, SweepSimulator, simulate_sweeps

SMALL = SimulationSettings(seed=5, num_beams=16, num_columns=300)
EXACT = replace(SMALL, range_noise_m=0.0, dropout=0.0)


def rigid_flow(now, then):
    """Flow of the points of a sweep if the world were static, by the recorded poses."""
    next_from_current = invert(then.world_from_sensor) @ now.world_from_sensor
    return apply(next_from_current, now.xyz.astype(float)) - now.xyz


def test_equal_seeds_give_equal_sweeps():
    few = replace(SMALL, duration_s=0.2)
    for one, other in zip(simulate_sweeps(few), simulate_sweeps(few), strict=True):
        for name in ("xyz", "intensity", "ring", "flow", "dynamic", "ground", "class_id", "body"):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name
        assert one.stamp_ns == other.stamp_ns


def test_other_seed_gives_another_street():
    one, other = (SweepSimulator(replace(EXACT, seed=seed)).sweep(0) for seed in (5, 6))
    assert one.xyz.shape != other.xyz.shape or not np.allclose(one.xyz, other.xyz, atol=0.5)


def test_arrays_fit_together():
    sweep = SweepSimulator(SMALL).sweep(7)
    n = len(sweep.xyz)
    assert 0.9 * 16 * 300 * 0.9 < n <= 16 * 300
    assert sweep.xyz.shape == sweep.flow.shape == (n, 3)
    assert sweep.xyz.dtype == sweep.flow.dtype == sweep.intensity.dtype == np.float32
    assert sweep.ring.dtype == np.uint16
    assert sweep.class_id.dtype == np.uint8
    assert sweep.body.dtype == np.int32
    for name in ("intensity", "ring", "dynamic", "ground", "class_id", "body"):
        assert getattr(sweep, name).shape == (n,), name
    assert np.isfinite(sweep.xyz).all()
    assert np.isfinite(sweep.flow).all()
    assert set(np.unique(sweep.class_id)) <= {int(c) for c in SurfaceClass}
    assert 0 <= sweep.intensity.min() <= sweep.intensity.max() <= 255
    assert np.linalg.norm(sweep.xyz, axis=1).max() <= SMALL.max_range_m + 0.2


def test_stamps_are_evenly_spaced():
    few = replace(SMALL, duration_s=0.3, rate_hz=30.0)
    stamps = [sweep.stamp_ns for sweep in simulate_sweeps(few)]
    assert stamps[0] == FIRST_STAMP_NS
    assert np.allclose(np.diff(stamps), 1e9 / 30, atol=1)


def test_rings_rise_from_the_ground():
    sweep = SweepSimulator(EXACT).sweep(0)
    elevation = np.arcsin(sweep.xyz[:, 2] / np.linalg.norm(sweep.xyz, axis=1))
    means = [elevation[sweep.ring == ring].mean() for ring in range(16)]
    assert np.all(np.diff(means) > 0)


def test_static_points_flow_as_the_sensor_moves():
    simulator = SweepSimulator(SMALL)
    for index in (3, 40, 90):
        now, then = simulator.sweep(index), simulator.sweep(index + 1)
        residual = np.linalg.norm(now.flow - rigid_flow(now, then), axis=1)
        still = ~now.dynamic
        # Standing people and cars about to halt may creep without counting as dynamic.
        assert residual[still].max() <= 0.05 + 1e-5
        assert np.mean(residual[still] < 1e-5) > 0.99
        assert residual[now.dynamic].min() >= 0.05 - 1e-5
        assert not now.dynamic[now.ground].any()


def test_only_things_that_can_move_are_dynamic():
    sweep = SweepSimulator(SMALL).sweep(50)
    movable = {SurfaceClass.CAR, SurfaceClass.PEDESTRIAN, SurfaceClass.CYCLIST}
    assert set(sweep.class_id[sweep.dynamic]) <= {int(c) for c in movable}
    assert sweep.dynamic.sum() > 50
    parked = (sweep.class_id == SurfaceClass.CAR) & ~sweep.dynamic
    assert parked.sum() > 50


def test_dynamic_means_half_a_meter_per_second_at_any_rate():
    slow, fast = (
        SweepSimulator(replace(EXACT, rate_hz=rate)).sweep(int(rate)) for rate in (10.0, 20.0)
    )
    assert slow.stamp_ns == fast.stamp_ns
    assert slow.dynamic.mean() == pytest.approx(fast.dynamic.mean(), abs=0.02)


@pytest.mark.parametrize("index", [2, 70])
def test_points_and_moved_points_lie_on_their_surfaces(index):
    simulator = SweepSimulator(EXACT)
    now, then = simulator.sweep(index), simulator.sweep(index + 1)
    moved = now.xyz.astype(float) + now.flow
    for pose, points, time_s in (
        (now.world_from_sensor, now.xyz.astype(float), index * 0.1),
        (then.world_from_sensor, moved, (index + 1) * 0.1),
    ):
        world = apply(pose, points)
        assert np.abs(ground_distance(world[now.ground])).max() < 1e-3
        things = world[~now.ground]
        assert len(things) > 500
        assert nearest_surface(simulator.scene, things, time_s).max() < 1e-3


def ground_distance(world):
    """Height above asphalt or sidewalk level, zero between them, where curbs are."""
    height = world[:, 2]
    return np.where(height < 0.0, height, np.maximum(height - CURB_HEIGHT_M, 0.0))


def nearest_surface(scene, world, time_s):
    nearest = np.full(len(world), np.inf)
    for body in scene.bodies:
        for shape in body.model.shapes:
            pose = body.world_from_body(time_s) @ shape.body_from_shape
            reach = np.linalg.norm(shape.half_extents) + 0.1
            close = np.flatnonzero(np.linalg.norm(world - pose[:3, 3], axis=1) < reach)
            local = apply(invert(pose), world[close])
            distance = np.abs(signed_distance(shape.kind, shape.half_extents, local))
            nearest[close] = np.minimum(nearest[close], distance)
    return nearest


def test_moved_points_meet_the_next_sweep():
    settings = SimulationSettings(seed=1, num_beams=64, num_columns=1000)
    simulator = SweepSimulator(settings)
    now, then = simulator.sweep(20), simulator.sweep(21)
    near = np.linalg.norm(now.xyz, axis=1) < 25.0
    tree = cKDTree(then.xyz)
    with_flow = tree.query((now.xyz + now.flow)[near & now.dynamic])[0]
    without = tree.query(now.xyz[near & now.dynamic])[0]
    assert len(with_flow) > 300
    assert np.median(with_flow) < 0.08
    assert np.percentile(with_flow, 90) < 0.4
    assert np.median(without) > 3 * np.median(with_flow)
    assert np.median(tree.query((now.xyz + now.flow)[near])[0]) < 0.08


def test_noise_moves_points_along_their_rays_only():
    noisy = replace(EXACT, range_noise_m=0.05)
    clean_sweep, noisy_sweep = (SweepSimulator(s).sweep(4) for s in (EXACT, noisy))
    clean_range = np.linalg.norm(clean_sweep.xyz, axis=1)
    noisy_range = np.linalg.norm(noisy_sweep.xyz, axis=1)
    error = noisy_range - clean_range
    assert error.std() == pytest.approx(0.05, rel=0.05)
    assert abs(error.mean()) < 0.005
    direction = noisy_sweep.xyz / noisy_range[:, None]
    assert np.allclose(direction, clean_sweep.xyz / clean_range[:, None], atol=1e-5)


def test_dropout_loses_its_share():
    kept = len(SweepSimulator(replace(EXACT, dropout=0.3)).sweep(0).xyz)
    assert kept / len(SweepSimulator(EXACT).sweep(0).xyz) == pytest.approx(0.7, abs=0.03)


def test_standing_vehicle_only_sways():
    sweep = SweepSimulator(replace(EXACT, ego_speed_m_s=0.0)).sweep(10)
    near = ~sweep.dynamic & (np.linalg.norm(sweep.xyz, axis=1) < 20.0)
    assert 0.0 < np.linalg.norm(sweep.flow[near], axis=1).max() < 0.06


def test_movers_stay_in_view_and_counts_are_as_promised():
    simulator = SweepSimulator(SimulationSettings())
    for index in (0, 25, 50, 75, 99):
        sweep = simulator.sweep(index)
        assert 100_000 <= len(sweep.xyz) <= 121_600
        assert sweep.dynamic.sum() > 1500
