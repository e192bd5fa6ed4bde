# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Simulated sweeps: exact truth in every scenario, lidars that roll, rain, glass, and settings."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from slow_geometry import corners, overlap, signed_distance

from mnsf_ros.errors import SettingsError
from mnsf_ros.geometry.transforms import apply, invert
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation.routes import EGO_LENGTH_M, EGO_WIDTH_M
from mnsf_ros.simulation.scenarios import STAGES, Sensor
from mnsf_ros.simulation.scene import build_scene
from mnsf_ros.simulation.settings import SCENARIOS, SimulationSettings
from mnsf_ros.simulation.street import CURB_HEIGHT_M
from mnsf_ros.simulation.sweeps import FIRST_STAMP_NS, SweepSimulator, simulate_sweeps

INTERVAL_S = 0.1
EXACT = SimulationSettings(
    seed=1, num_beams=32, num_columns=600, range_noise_m=0.0, dropout=0.0, duration_s=4.0
)
SMALL = SimulationSettings(seed=5, num_beams=16, num_columns=300)
ROLLING = STAGES["bent_sweeps"]
CUT_BY_TIME = replace(ROLLING, sensor=Sensor(is_rolling=True, degrees=395.0))


def of(name, **changes):
    return replace(EXACT, scenario=name, **changes)


def moments(simulator, sweep, index):
    """Time of each moment at which points were measured, and their rows."""
    times_ns = np.zeros(len(sweep.xyz)) if sweep.times_ns is None else sweep.times_ns
    for after_ns in np.unique(times_ns):
        yield index * INTERVAL_S + after_ns * 1e-9, np.flatnonzero(times_ns == after_ns)


def off_surface(scene, sweep, rows, world, time_s):
    """How far points are from the surface that they were measured on, at a time."""
    apart = np.full(len(rows), np.inf)
    on_ground = sweep.body[rows] < 0
    height = world[on_ground, 2]
    apart[on_ground] = np.where(height < 0, -height, np.maximum(height - CURB_HEIGHT_M, 0.0))
    for number in np.unique(sweep.body[rows][~on_ground]):
        body, own = scene.bodies[number], np.flatnonzero(sweep.body[rows] == number)
        for shape in body.model.shapes:
            pose = body.world_from_body(time_s) @ shape.body_from_shape
            local = apply(invert(pose), world[own])
            distance = np.abs(signed_distance(shape.kind, shape.half_extents, local))
            apart[own] = np.minimum(apart[own], distance)
    return apart


@pytest.mark.parametrize("name", SCENARIOS)
def test_points_and_moved_points_lie_on_their_surfaces(name):
    simulator = SweepSimulator(of(name))
    for index in (4, 30):
        sweep = simulator.sweep(index)
        for time_s, measured in moments(simulator, sweep, index):
            rows = measured[sweep.valid[measured]]
            xyz, flow = (array[rows].astype(float) for array in (sweep.xyz, sweep.flow))
            for moved, then_s in ((xyz, time_s), (xyz + flow, time_s + INTERVAL_S)):
                world = apply(simulator.scene.ego.world_from_sensor(then_s), moved)
                assert off_surface(simulator.scene, sweep, rows, world, then_s).max() < 2e-3


def test_nothing_moves_in_the_standing_scene():
    sweep = SweepSimulator(of("standing")).sweep(20)
    assert not sweep.dynamic.any()
    assert np.unique(sweep.body).size > 20


@pytest.mark.parametrize("name", [name for name, stage in STAGES.items() if stage.movers])
def test_ids_are_stable_and_speeds_as_declared(name):
    simulator = SweepSimulator(of(name, num_columns=1800))
    now, then = simulator.sweep(20), simulator.sweep(21)
    moved = now.xyz.astype(float) + now.flow
    apart = []
    for number in np.unique(now.body[now.dynamic]):
        trip = simulator.scene.bodies[number].trip
        here, there = np.flatnonzero(now.body == number), np.flatnonzero(then.body == number)
        if min(len(here), len(there)) >= 20 and np.linalg.norm(now.xyz[here[0]]) < 25:
            apart.append(np.median(cKDTree(then.xyz[there]).query(moved[here])[0]))
        times_s = 2.0 + np.arange(0.0, 0.21, INTERVAL_S)
        places = trip.planar(times_s)[:, :2]
        measured = np.linalg.norm(np.diff(places, axis=0), axis=1) / INTERVAL_S
        declared = np.diff(trip.profile.distances(times_s)) / INTERVAL_S
        # A chord is a little shorter than its arc.
        assert measured == pytest.approx(declared, rel=0.02), number
    # Of some another part is seen, from behind a corner.
    assert np.median(apart) < 0.15


@pytest.mark.parametrize("name", STAGES)
def test_everything_that_is_declared_is_there_and_moves(name):
    declared = sum(mover.count for mover in STAGES[name].movers)
    for seed in range(3):
        scene = build_scene(of(name, seed=seed))
        movers = [body for body in scene.bodies if body.trip is not None]
        # In the crowd those who would run into others stay away.
        assert len(movers) == declared or (name == "crowd" and len(movers) >= 35)
        assert len(scene.bodies) > len(movers)


@pytest.mark.parametrize("name", SCENARIOS)
def test_equal_seeds_give_equal_sweeps_and_others_do_not(name):
    small = of(name, num_columns=90, num_beams=16, dropout=0.1)
    one, same, other = (SweepSimulator(replace(small, seed=seed)).sweep(2) for seed in (1, 1, 2))
    for field in ("xyz", "intensity", "ring", "flow", "dynamic", "class_id", "body", "valid"):
        assert np.array_equal(getattr(one, field), getattr(same, field)), field
    assert one.xyz.shape != other.xyz.shape or not np.allclose(one.xyz, other.xyz, atol=0.1)


@pytest.mark.parametrize(("stage", "degrees"), [(ROLLING, 360), (CUT_BY_TIME, 395)])
def test_points_of_a_rolling_sweep_have_their_own_times_and_turn_to_the_right(stage, degrees):
    sweep = SweepSimulator(EXACT, stage).sweep(3)
    assert sweep.times_ns.dtype == np.uint32
    assert np.all(np.diff(sweep.times_ns.astype(int)) >= 0)
    assert 0 < sweep.times_ns[0] < 2e6
    assert 98e6 < sweep.times_ns[-1] < 100e6
    azimuth = np.arctan2(sweep.xyz[:, 1], sweep.xyz[:, 0])
    middle = [
        np.angle(np.exp(1j * azimuth[sweep.times_ns == time_ns]).mean())
        for time_ns in np.unique(sweep.times_ns)
    ]
    turned = -np.diff(np.unwrap(middle))
    assert turned.sum() == pytest.approx(np.radians(degrees), rel=0.05)
    assert (turned > 0).all()


def test_a_sweep_that_is_cut_by_time_sees_a_part_twice_and_the_next_goes_on_there():
    simulator = SweepSimulator(EXACT, CUT_BY_TIME)
    first, second = simulator.sweep(0), simulator.sweep(1)

    def azimuth(sweep, rows):
        return np.degrees(np.arctan2(sweep.xyz[rows, 1], sweep.xyz[rows, 0])) % 360

    early, late = (azimuth(first, first.times_ns < 8e6), azimuth(first, first.times_ns > 92e6))
    assert np.intersect1d(early.astype(int), late.astype(int)).size >= 25
    begin = azimuth(second, second.times_ns < 2e6)
    end = azimuth(first, first.times_ns > 98e6)
    assert (end.min() - begin.max()) % 360 < 2.0


def test_static_points_measured_while_driving_fall_together_with_the_true_poses():
    simulator = SweepSimulator(of("bent_sweeps", num_columns=1800))
    still = []
    for index in (10, 11):
        sweep = simulator.sweep(index)
        world = np.full(sweep.xyz.shape, np.nan)
        for time_s, rows in moments(simulator, sweep, index):
            world[rows] = apply(
                simulator.scene.ego.world_from_sensor(time_s), sweep.xyz[rows].astype(float)
            )
        near = np.linalg.norm(sweep.xyz, axis=1) < 20
        still.append((world[near & ~sweep.dynamic], sweep.xyz[near & ~sweep.dynamic]))
    straight = cKDTree(still[0][0]).query(still[1][0])[0]
    bent = cKDTree(still[0][1]).query(still[1][1])[0]
    assert np.median(straight) < 0.06
    assert np.median(bent) > 2 * np.median(straight)


def test_rain_takes_far_returns_and_its_drops_have_no_flow():
    rain = replace(ROLLING, sensor=Sensor(rain_per_m=0.012))
    sun = replace(ROLLING, sensor=Sensor())
    wet, dry = (SweepSimulator(EXACT, stage).sweep(0) for stage in (rain, sun))
    assert (~wet.valid).sum() > 20
    assert np.linalg.norm(wet.xyz[~wet.valid], axis=1).max() < 8.0
    assert not wet.dynamic[~wet.valid].any()
    assert (wet.body[~wet.valid] == -1).all()
    assert dry.valid.all()
    share = [np.mean(np.linalg.norm(sweep.xyz, axis=1) > 20) for sweep in (wet, dry)]
    assert share[0] < 0.8 * share[1]


def test_windows_are_seen_squarely_and_looked_through_at_an_angle():
    sweep = SweepSimulator(of("standing", num_columns=1800)).sweep(0)
    world = apply(sweep.world_from_sensor, sweep.xyz.astype(float))
    x0, y0 = sweep.world_from_sensor[:2, 3]
    # The fronts of the shops are 10.5 m left of the road's middle, their panes 0.1 m behind.
    at_window = (
        (world[:, 2] > 0.7) & (world[:, 2] < 2.4) & (sweep.class_id == SurfaceClass.BUILDING)
    )
    left = at_window & (world[:, 0] < 30) & (world[:, 1] > 0)
    pane = left & (np.abs(world[:, 1] - 10.6) < 1e-5)
    inside = left & (world[:, 1] > 10.9)
    slope = np.abs(world[:, 0] - x0) / np.abs(world[:, 1] - y0)
    assert pane.sum() > 5
    assert inside.sum() > 20
    assert slope[pane].max() < np.tan(np.radians(15.5))


def rigid_flow(now, then):
    """Flow of the points of a sweep if the world were static, by the recorded poses."""
    next_from_current = invert(then.world_from_sensor) @ now.world_from_sensor
    return apply(next_from_current, now.xyz.astype(float)) - now.xyz


def test_stamps_are_evenly_spaced():
    few = replace(SMALL, duration_s=0.3, rate_hz=30.0)
    stamps = [sweep.stamp_ns for sweep in simulate_sweeps(few)]
    assert stamps[0] == FIRST_STAMP_NS
    assert np.allclose(np.diff(stamps), 1e9 / 30, atol=1)


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


def test_dynamic_means_half_a_meter_per_second_at_any_rate():
    slow, fast = (
        SweepSimulator(replace(EXACT, rate_hz=rate)).sweep(int(rate)) for rate in (10.0, 20.0)
    )
    assert slow.stamp_ns == fast.stamp_ns
    assert slow.dynamic.mean() == pytest.approx(fast.dynamic.mean(), abs=0.02)


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


def test_default_sweeps_are_large_and_have_movers():
    simulator = SweepSimulator(SimulationSettings())
    for index in (0, 50, 99):
        sweep = simulator.sweep(index)
        assert 100_000 <= len(sweep.xyz) <= 121_600
        assert np.linalg.norm(sweep.xyz, axis=1).max() <= 120.2
        assert sweep.dynamic.sum() > 1500
        movable = {SurfaceClass.CAR, SurfaceClass.PEDESTRIAN, SurfaceClass.CYCLIST}
        assert set(sweep.class_id[sweep.dynamic]) <= {int(kind) for kind in movable}
        assert 0 <= sweep.intensity.min() <= sweep.intensity.max() <= 255


@pytest.mark.parametrize(("seed", "speed"), [(6, 8.0), (3, 0.0)])
def test_moving_things_touch_nothing(seed, speed):
    scene = build_scene(SimulationSettings(seed=seed, ego_speed_m_s=speed))
    times_s = np.arange(0.0, 10.15, 0.1)
    moving = [corners(scene.ego.trip.planar(times_s), EGO_LENGTH_M, EGO_WIDTH_M)]
    static = []
    for body in scene.bodies:
        model = body.model
        if body.trip is None:
            pose = body.placement
            planar = np.array([[*pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0])]])
            place = corners(planar, model.length_m, model.width_m)
            static.append(np.broadcast_to(place, (len(times_s), 4, 2)))
        else:
            moving.append(corners(body.trip.planar(times_s), model.length_m, model.width_m))
    assert len(moving) > 20
    for one, other in [*itertools.combinations(moving, 2), *itertools.product(moving, static)]:
        is_far = np.any(one.min((0, 1)) > other.max((0, 1)))
        if not is_far and not np.any(other.min((0, 1)) > one.max((0, 1))):
            assert not overlap(one, other).any()


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("seed", -1, "seed: got -1, expected a whole number from 0 to 9223372036854775807"),
        ("duration_s", float("nan"), "duration_s: got nan, expected a number"),
        ("num_beams", 48, r"num_beams: got 48, expected one of \(16, 32, 64, 128\)"),
        ("dropout", 1.0, "dropout: must be below 1"),
        ("ego_speed_m_s", "8", "ego_speed_m_s: got '8', expected a number"),
        ("scenario", "mall", "scenario: got 'mall', expected one of street, "),
    ],
)
def test_bad_value_is_named(name, value, text):
    with pytest.raises(SettingsError, match=text):
        SimulationSettings(**{name: value})
