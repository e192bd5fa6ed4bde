# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Staged scenarios: they hold what they declare, and their truth is exact, whoever looks how."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from slow_geometry import signed_distance

from mnsf_ros.geometry.transforms import apply, invert
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.recording.truth import read_truth
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.scenarios import STAGES
from mnsf_ros.simulation.scene import build_scene
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.street import CURB_HEIGHT_M
from mnsf_ros.simulation.sweeps import SweepSimulator
from msg_utils.point_cloud2 import decode_points

EXACT = SimulationSettings(
    seed=1, num_beams=32, num_columns=600, range_noise_m=0.0, dropout=0.0, duration_s=4.0
)
INTERVAL_S = 0.1
ROLLING = ("seam", "bent_sweeps")


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


@pytest.mark.parametrize("name", STAGES)
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


@pytest.mark.parametrize(("name", "num_beams"), [*((name, 16) for name in STAGES), ("bus", 128)])
def test_equal_seeds_give_equal_sweeps_and_others_do_not(name, num_beams):
    small = of(name, num_columns=90, num_beams=num_beams, dropout=0.1)
    one, same, other = (SweepSimulator(replace(small, seed=seed)).sweep(2) for seed in (1, 1, 2))
    for field in ("xyz", "flow", "body", "valid", "intensity"):
        assert np.array_equal(getattr(one, field), getattr(same, field)), field
    assert one.xyz.shape != other.xyz.shape or not np.allclose(one.xyz, other.xyz, atol=0.1)


@pytest.mark.parametrize(
    ("name", "slowest", "fastest", "kind"),
    [
        ("slow_walkers", 0.3, 1.0, SurfaceClass.PEDESTRIAN),
        ("scooters", 11.0, 13.0, SurfaceClass.CYCLIST),
        ("crossing", 20.0, 20.0, SurfaceClass.CAR),
        ("bus", 5.0, 6.0, SurfaceClass.LARGE_VEHICLE),
    ],
)
def test_speeds_of_the_scenarios_are_those_of_their_description(name, slowest, fastest, kind):
    speeds = [
        body.trip.profile.speeds_m_s.max()
        for body in build_scene(of(name)).bodies
        if body.trip is not None and body.model.surface_class is kind
    ]
    assert min(speeds) == pytest.approx(slowest)
    assert max(speeds) == pytest.approx(fastest)


def test_both_parts_of_a_bus_turn_by_a_right_angle_and_stay_together():
    buses = [
        body.trip
        for body in build_scene(of("bus")).bodies
        if body.model.surface_class is SurfaceClass.LARGE_VEHICLE
    ]
    assert len(buses) == 4
    times_s = np.linspace(0.0, 10.0, 101)
    for front, rear in (buses[:2], buses[2:]):
        one, other = front.planar(times_s), rear.planar(times_s)
        assert abs(one[-1, 2] - one[0, 2]) == pytest.approx(np.pi / 2, abs=0.01)
        apart = np.linalg.norm(one[:, :2] - other[:, :2], axis=1)
        assert 7.5 < apart.min() < 9.0
        assert apart.max() < 10.1
        assert np.abs(one[:, 2] - other[:, 2]).max() > 0.5


def test_the_robot_turns_on_the_spot_on_the_parking_lot():
    ego = build_scene(of("parking_lot")).ego
    poses = ego.trip.planar(np.array([0.0, 1.0, 2.0]))
    assert np.ptp(poses[:, :2]) == 0.0
    assert np.diff(np.degrees(poses[:, 2])) == pytest.approx([40.0, 40.0])


@pytest.mark.parametrize("name", ROLLING)
def test_points_of_a_rolling_sweep_have_their_own_times_and_turn_to_the_right(name):
    sweep = SweepSimulator(of(name)).sweep(3)
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
    assert turned.sum() == pytest.approx(np.radians({"seam": 395}.get(name, 360)), rel=0.05)
    assert (turned > 0).all()


def test_a_sweep_that_is_cut_by_time_sees_a_part_twice_and_the_next_goes_on_there():
    simulator = SweepSimulator(of("seam"))
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
    wet, dry = (SweepSimulator(of(name)).sweep(0) for name in ("rain", "seam"))
    assert (~wet.valid).sum() > 20
    drops = wet.xyz[~wet.valid]
    assert np.linalg.norm(drops, axis=1).max() < 8.0
    assert not wet.dynamic[~wet.valid].any()
    assert (wet.body[~wet.valid] == -1).all()
    assert dry.valid.all()
    share = [np.mean(np.linalg.norm(sweep.xyz, axis=1) > 20) for sweep in (wet, dry)]
    assert share[0] < 0.8 * share[1]


def test_windows_are_seen_squarely_and_looked_through_at_an_angle():
    simulator = SweepSimulator(of("alley", num_columns=1800))
    sweep = simulator.sweep(0)
    world = apply(sweep.world_from_sensor, sweep.xyz.astype(float))
    x0, y0 = sweep.world_from_sensor[:2, 3]
    at_window = (
        (world[:, 2] > 0.7) & (world[:, 2] < 2.4) & (sweep.class_id == SurfaceClass.BUILDING)
    )
    pane = at_window & (np.abs(np.abs(world[:, 1]) - 3.6) < 1e-5)
    inside = at_window & (np.abs(world[:, 1]) > 3.9)
    slope = np.abs(world[:, 0] - x0) / np.abs(world[:, 1] - y0)
    assert pane.sum() > 20
    assert inside.sum() > 200
    assert slope[pane].max() < np.tan(np.radians(15.5))


def test_recordings_hold_times_and_instances(tmp_path):
    settings = of("seam", duration_s=0.3, num_columns=200)
    write_recording(settings, tmp_path / "seam")
    simulator = SweepSimulator(settings)
    with BagReader(tmp_path / "seam") as reader:
        truth = read_truth(reader)
        for index, message in enumerate(reader.messages("/points")):
            points, sweep = decode_points(message).ravel(), simulator.sweep(index)
            assert points.dtype.names == ("x", "y", "z", "intensity", "ring", "t")
            assert points["t"].dtype == np.uint32
            assert np.array_equal(points["t"], sweep.times_ns)
            found = truth[sweep.stamp_ns]
            assert np.array_equal(found.object_id, sweep.body + 1)
            rows = np.array([5, 3])
            assert np.array_equal(found.of_points(rows).object_id, sweep.body[rows] + 1)
