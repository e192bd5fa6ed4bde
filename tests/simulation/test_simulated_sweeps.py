# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Simulated sweeps: exact truth in random worlds, lidars that roll, rain, glass, and settings."""

import itertools
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.spatial import cKDTree
from slow_geometry import corners, overlap, signed_distance

from mnsf_ros.errors import SettingsError
from mnsf_ros.geometry.transforms import apply, invert, planar_pose
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation.bodies import Shape, ShapeKind, box
from mnsf_ros.simulation.lidar import Rays, ShapeTable
from mnsf_ros.simulation.settings import SCENARIOS, SimulationSettings
from mnsf_ros.simulation.street import CURB_HEIGHT_M
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.simulation.worlds import build_scene

STREET = SimulationSettings(seed=1, num_beams=32, num_columns=600, duration_s=4.0)
SMALL = SimulationSettings(seed=5, num_beams=16, num_columns=300)


def world(seed):
    """The simulator of a random world."""
    return SweepSimulator(SimulationSettings(seed=seed, scenario="random"))


def adverse(seed):
    """The simulator of an adverse world."""
    return SweepSimulator(SimulationSettings(seed=seed, scenario="adverse"))


def indoors(scenario, seed):
    """The simulator of rooms."""
    return SweepSimulator(SimulationSettings(seed=seed, scenario=scenario))


def first_world(is_wanted, seeds=range(40)):
    """The first random world of a kind."""
    return next(each for each in map(world, seeds) if is_wanted(each.scene))


def with_sensor(simulator, **changes):
    simulator.scene = replace(simulator.scene, sensor=replace(simulator.scene.sensor, **changes))
    return simulator


def exact(simulator):
    return with_sensor(simulator, range_noise_m=0.0, dropout=0.0)


def exact_street(**changes):
    return exact(SweepSimulator(replace(STREET, **changes)))


def moments(simulator, sweep, index):
    """Time of each moment at which points were measured, and their rows."""
    times_ns = sweep.columns.get("t", np.zeros(len(sweep.xyz)))
    for after_ns in np.unique(times_ns):
        yield simulator.times_s[index] + after_ns * 1e-9, np.flatnonzero(times_ns == after_ns)


def off_surface(scene, sweep, rows, world, time_s):
    """How far points are from the surface that they were measured on, at a time."""
    apart = np.full(len(rows), np.inf)
    on_ground = sweep.truth.object_id[rows] == 0
    slope = scene.street.slope
    climbs = (world[:, 0] > slope.start_x) & (slope.grade != 0)
    level = world[:, 2].copy()
    if climbs.any():
        level[climbs] = apply(invert(slope.world_from_climb), world[climbs])[:, 2]
    height = level[on_ground]
    apart[on_ground] = np.where(height < 0, -height, np.maximum(height - CURB_HEIGHT_M, 0.0))
    for number in np.unique(sweep.truth.object_id[rows][~on_ground]):
        body, own = scene.bodies[number - 1], np.flatnonzero(sweep.truth.object_id[rows] == number)
        for shape in body.model.shapes:
            pose = body.world_from_body(time_s) @ shape.body_from_shape
            local = apply(invert(pose), world[own])
            distance = np.abs(signed_distance(shape.kind, shape.half_extents, local))
            apart[own] = np.minimum(apart[own], distance)
    return apart


SIMULATORS = [
    exact_street,
    *(partial(world, seed) for seed in range(12)),
    *(partial(adverse, seed) for seed in range(3)),
    *(partial(indoors, *each) for each in (("rooms", 1), ("rooms", 2), ("carried", 4))),
]


@pytest.mark.parametrize("simulator", SIMULATORS)
def test_points_and_moved_points_lie_on_their_surfaces(simulator):
    simulator = exact(simulator())
    for index in (4, 30):
        sweep = simulator.sweep(index)
        interval_s = simulator.times_s[index + 1] - simulator.times_s[index]
        for time_s, measured in moments(simulator, sweep, index):
            rows = measured[sweep.truth.valid[measured]]
            xyz, flow = (array[rows].astype(float) for array in (sweep.xyz, sweep.truth.flow))
            for moved, then_s in ((xyz, time_s), (xyz + flow, time_s + interval_s)):
                at = apply(simulator.scene.ego.world_from_sensor(then_s), moved)
                assert off_surface(simulator.scene, sweep, rows, at, then_s).max() < 2e-3


def test_worlds_have_every_lidar_place_ego_motion_and_kind_of_traffic():
    scenes = [build_scene(SimulationSettings(seed=seed, scenario="random")) for seed in range(60)]
    text = "\n".join(scene.text for scene in scenes)
    lidars = ("16 beams", "32 beams", "64 beams", "128 beams", "solid state", "20 Hz", "rain")
    places = ("; street", "crossing", "country road", "square", "tunnel", "slope")
    egos = ("standing", "on foot", "driving", "fast")
    kinds = ("car", "van", "lorry", "coach", "articulated bus", "trailer", "cyclist", "scooter")
    for name in (*lidars, *places, *egos, *kinds, "pedestrian", "child", "dog"):
        assert name in text, name
    sensors = [scene.sensor for scene in scenes]
    assert {sensor.is_rosette for sensor in sensors} == {True, False}
    assert {sensor.is_rolling for sensor in sensors} == {True, False}
    assert {395.0, 360.0} < {sensor.degrees for sensor in sensors}
    trips = [body.trip for scene in scenes for body in scene.bodies if body.trip is not None]
    speeds = np.array([trip.profile.speeds_m_s[[0, -1]] for trip in trips])
    assert {tuple(pair) for pair in np.sign(speeds).tolist()} > {(0, 1), (1, 0), (1, 1)}
    turns = np.array([np.ptp(trip.planar(np.array([0.0, 2.0]))[:, 2]) for trip in trips])
    assert 0.05 < np.mean(turns > 0.1) < 0.5


def test_nothing_moves_in_the_standing_scene():
    simulators = [SweepSimulator(SimulationSettings(seed, scenario="standing")) for seed in (3, 10)]
    for simulator in simulators:
        sweep = simulator.sweep(5)
        assert not sweep.truth.dynamic.any()
        assert np.unique(sweep.truth.object_id).size > 20


def test_a_shorter_recording_of_a_world_is_the_beginning_of_a_longer_one():
    settings = SimulationSettings(seed=3, scenario="random", duration_s=0.2)
    for sweep, same in zip(SweepSimulator(settings), map(world(3).sweep, range(2)), strict=True):
        assert np.array_equal(sweep.truth.flow, same.truth.flow)


@pytest.mark.parametrize("seed", [5, 11, 17])
def test_objects_move_as_the_truth_says(seed):
    simulator = world(seed)
    now, then = simulator.sweep(20), simulator.sweep(21)
    moved = now.xyz.astype(float) + now.truth.flow
    apart = []
    for number in np.unique(now.truth.object_id[now.truth.dynamic]):
        here, there = (
            np.flatnonzero(now.truth.object_id == number),
            np.flatnonzero(then.truth.object_id == number),
        )
        if min(len(here), len(there)) >= 20 and np.linalg.norm(now.xyz[here[0]]) < 25:
            apart.append(np.median(cKDTree(then.xyz[there]).query(moved[here])[0]))
    assert len(apart) >= 2
    # Of some another part is seen, from behind a corner.
    assert np.median(apart) < 0.15


@pytest.mark.parametrize("name", SCENARIOS)
def test_equal_seeds_give_equal_sweeps_and_others_do_not(name):
    settings = [SimulationSettings(seed, scenario=name) for seed in (1, 1, 2)]
    one, same, other = (SweepSimulator(each).sweep(2) for each in settings)
    assert np.array_equal(one.xyz, same.xyz)
    for field in one.columns:
        assert np.array_equal(one.columns[field], same.columns[field]), field
    for field in ("flow", "dynamic", "class_id", "object_id", "valid"):
        assert np.array_equal(getattr(one.truth, field), getattr(same.truth, field)), field
    assert one.xyz.shape != other.xyz.shape


@pytest.mark.parametrize("degrees", [360.0, 395.0, 120.0])
def test_points_of_a_rolling_sweep_have_their_own_times_and_turn_to_the_right(degrees):
    rolling = with_sensor(exact_street(), is_rolling=True, degrees=degrees)
    sweep = rolling.sweep(3)
    assert sweep.columns["t"].dtype == np.uint32
    assert np.all(np.diff(sweep.columns["t"].astype(int)) >= 0)
    assert 0 < sweep.columns["t"][0] < 2e6
    assert 98e6 < sweep.columns["t"][-1] < 100e6
    azimuth = np.arctan2(sweep.xyz[:, 1], sweep.xyz[:, 0])
    middle = [
        np.angle(np.exp(1j * azimuth[sweep.columns["t"] == time_ns]).mean())
        for time_ns in np.unique(sweep.columns["t"])
    ]
    turned = -np.diff(np.unwrap(middle))
    assert turned.sum() == pytest.approx(np.radians(degrees), rel=0.05)
    assert (turned > 0).all()
    if degrees < 360:
        assert np.degrees(np.abs(azimuth)).max() == pytest.approx(degrees / 2, abs=1.5)


def test_a_sweep_that_is_cut_by_time_sees_a_part_twice_and_the_next_goes_on_there():
    simulator = with_sensor(exact_street(), is_rolling=True, degrees=395.0)
    first, second = simulator.sweep(0), simulator.sweep(1)

    def azimuth(sweep, rows):
        return np.degrees(np.arctan2(sweep.xyz[rows, 1], sweep.xyz[rows, 0])) % 360

    early, late = (
        azimuth(first, first.columns["t"] < 8e6),
        azimuth(first, first.columns["t"] > 92e6),
    )
    assert np.intersect1d(early.astype(int), late.astype(int)).size >= 25
    begin = azimuth(second, second.columns["t"] < 2e6)
    end = azimuth(first, first.columns["t"] > 98e6)
    assert (end.min() - begin.max()) % 360 < 2.0


def test_a_rosette_fills_the_view_and_never_repeats_itself():
    simulator = exact(first_world(lambda scene: scene.sensor.is_rosette))
    first, second = simulator.sweep(0), simulator.sweep(1)
    azimuth = [np.degrees(np.arctan2(each.xyz[:, 1], each.xyz[:, 0])) for each in (first, second)]
    half = simulator.scene.sensor.degrees / 2
    assert 0.8 * half < np.abs(azimuth[0]).max() <= half
    assert len(np.unique(first.columns["t"])) > 5
    assert np.intersect1d(azimuth[0], azimuth[1]).size < 0.01 * len(first.xyz)


def test_static_points_measured_while_driving_fall_together_with_the_true_poses():
    fast = replace(STREET, num_columns=1800, ego_speed_m_s=18.0)
    simulator = with_sensor(exact(SweepSimulator(fast)), is_rolling=True)
    still = []
    for index in (10, 11):
        sweep = simulator.sweep(index)
        at = np.full(sweep.xyz.shape, np.nan)
        for time_s, rows in moments(simulator, sweep, index):
            at[rows] = apply(
                simulator.scene.ego.world_from_sensor(time_s), sweep.xyz[rows].astype(float)
            )
        near = (np.linalg.norm(sweep.xyz, axis=1) < 20) & ~sweep.truth.ground & ~sweep.truth.dynamic
        still.append((at[near], sweep.xyz[near]))
    straight = cKDTree(still[0][0]).query(still[1][0])[0]
    bent = cKDTree(still[0][1]).query(still[1][1])[0]
    assert np.median(straight) < 0.12
    assert np.median(bent) > 2 * np.median(straight)


def test_rain_takes_far_returns_and_its_drops_have_no_flow():
    simulators = (with_sensor(exact_street(), rain_per_m=loss) for loss in (0.012, 0.0))
    wet, dry = (simulator.sweep(0) for simulator in simulators)
    assert (~wet.truth.valid).sum() > 20
    assert np.linalg.norm(wet.xyz[~wet.truth.valid], axis=1).max() < 8.0
    assert not wet.truth.dynamic[~wet.truth.valid].any()
    assert (wet.truth.object_id[~wet.truth.valid] == 0).all()
    assert dry.truth.valid.all()
    share = [np.mean(np.linalg.norm(sweep.xyz, axis=1) > 20) for sweep in (wet, dry)]
    assert share[0] < 0.8 * share[1]


def test_windows_are_seen_squarely_and_looked_through_at_an_angle():
    rays = Rays(np.radians(np.arange(-60.0, 61.0)), np.zeros((1, 1)))
    pane = Shape(ShapeKind.BOX, (20.0, 0.01, 2.0), planar_pose(10.0, 0.0, np.pi / 2), is_glass=True)
    wall = box((14.0, 15.0), (-50.0, 50.0), (-2.0, 2.0))
    _, shapes = ShapeTable([pane, wall], [0, 1]).cast(rays, np.array([np.eye(4)] * 2), (0.9, 120.0))
    angle = np.degrees(np.abs(rays.azimuth))
    assert (shapes[angle < 14.5] == 0).all()
    assert (shapes[angle > 15.5] == 1).all()


def rigid_flow(now, then):
    """Flow of the points of a sweep if the world were static, by the recorded poses."""
    next_from_current = invert(then.pose) @ now.pose
    return apply(next_from_current, now.xyz.astype(float)) - now.xyz


def test_static_points_flow_as_the_sensor_moves():
    simulator = SweepSimulator(SMALL)
    for index in (3, 40, 90):
        now, then = simulator.sweep(index), simulator.sweep(index + 1)
        residual = np.linalg.norm(now.truth.flow - rigid_flow(now, then), axis=1)
        still = ~now.truth.dynamic
        # Standing people and cars about to halt may creep without counting as dynamic.
        assert residual[still].max() <= 0.05 + 1e-5
        assert np.mean(residual[still] < 1e-5) > 0.99
        assert residual[now.truth.dynamic].min() >= 0.05 - 1e-5
        assert not now.truth.dynamic[now.truth.ground].any()


def test_dynamic_means_half_a_meter_per_second_at_any_rate():
    slow, fast = (exact_street(rate_hz=rate).sweep(int(rate)) for rate in (10.0, 20.0))
    assert slow.truth.stamp_ns == fast.truth.stamp_ns
    assert slow.truth.dynamic.mean() == pytest.approx(fast.truth.dynamic.mean(), abs=0.02)


def test_default_sweeps_are_large_and_have_movers():
    simulator = SweepSimulator(SimulationSettings())
    for index in (0, 50, 99):
        sweep = simulator.sweep(index)
        assert 100_000 <= len(sweep.xyz) <= 121_600
        assert np.linalg.norm(sweep.xyz, axis=1).max() <= 120.2
        assert sweep.truth.dynamic.sum() > 1500
        assert {SurfaceClass.CAR, SurfaceClass.PEDESTRIAN} < set(
            sweep.truth.class_id[sweep.truth.dynamic]
        )
        assert 0 <= sweep.columns["intensity"].min() <= sweep.columns["intensity"].max() <= 255


@pytest.mark.parametrize(("seed", "speed"), [(6, 8.0), (3, 0.0)])
def test_moving_things_touch_nothing(seed, speed):
    scene = build_scene(SimulationSettings(seed=seed, ego_speed_m_s=speed))
    times_s = np.arange(0.0, 10.15, 0.1)
    trips = {scene.ego.trip.profile: [corners(scene.ego.trip.planar(times_s), 4.4, 1.8)]}
    static = []
    for body in scene.bodies:
        size = (body.model.length_m, body.model.width_m)
        if body.trip is not None:
            # Those who go together have the same profile, and may touch each other.
            trips.setdefault(body.trip.profile, []).append(
                corners(body.trip.planar(times_s), *size)
            )
            continue
        pose = body.placement
        planar = np.array([[*pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0])]])
        static.append(np.broadcast_to(corners(planar, *size), (len(times_s), 4, 2)))
    assert len(trips) > 12
    for group, others in itertools.combinations([*trips.values(), static], 2):
        for one, other in itertools.product(group, others):
            is_far = np.any(one.min((0, 1)) > other.max((0, 1)))
            if not is_far and not np.any(other.min((0, 1)) > one.max((0, 1))):
                assert not overlap(one, other).any()


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("seed", -1, "seed: got -1, expected a whole number from 0 to 9223372036854775807"),
        ("duration_s", float("nan"), "duration_s: got nan, expected a number"),
        ("num_beams", 48, "num_beams: got 48, expected 16, 32, 64 or 128"),
        ("ego_speed_m_s", "8", "ego_speed_m_s: got '8', expected a number"),
        ("scenario", "mall", "scenario: got 'mall', expected one of street, "),
    ],
)
def test_bad_value_is_named(name, value, text):
    with pytest.raises(SettingsError, match=text):
        SimulationSettings(**{name: value})


def test_what_a_random_world_draws_cannot_be_set():
    with pytest.raises(SettingsError, match="num_beams: got 16, but the scenario random draws it"):
        SimulationSettings(scenario="random", num_beams=16)
