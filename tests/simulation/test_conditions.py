# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Adverse worlds: each condition does to sweeps what it does in real recordings."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from slow_geometry import signed_distance

from mnsf_ros.errors import SettingsError
from mnsf_ros.geometry.transforms import apply, invert
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation.returns import are_returned, reflectance
from mnsf_ros.simulation.settings import CONDITIONS, SimulationSettings, scenario_of
from mnsf_ros.simulation.sweeps import FIRST_STAMP_NS, SweepSimulator
from mnsf_ros.simulation.worlds import build_scene


def settings(seed, conditions):
    return SimulationSettings(seed, scenario="adverse", conditions=conditions)


def first(conditions, is_wanted, seeds=range(60)):
    """The first world with conditions whose scene is wanted."""
    seed = next(s for s in seeds if is_wanted(build_scene(settings(s, conditions))))
    return SweepSimulator(settings(seed, conditions))


def drives(scene):
    return "driving" in scene.text and scene.ego.trip.profile.speeds_m_s.size == 1


def test_each_world_has_some_conditions_and_says_which():
    drawn = [scenario_of(settings(seed, "drawn")).conditions for seed in range(40)]
    counts = [sum(name in each for each in drawn) for name in CONDITIONS]
    assert 5 < min(counts) <= max(counts) < 30
    text = build_scene(settings(1, "drawn")).text.partition(";")[0].split(", ")
    assert drawn[1] == {*text} & {*CONDITIONS}


def test_one_condition_changes_nothing_that_is_drawn_for_another():
    alone, both = (build_scene(settings(3, names)) for names in ("fog", "body,fog"))
    assert alone.sensor.fog_per_m == both.sensor.fog_per_m > 0
    assert len(both.bodies) == len(alone.bodies) + 1


def test_a_missing_sweep_leaves_a_gap():
    simulator = SweepSimulator(settings(1, "gaps"))
    steps = np.diff(simulator.times_s) / simulator.interval_s
    assert steps == pytest.approx(np.round(steps))
    assert 0.02 < np.mean(steps > 1.5) < 0.3
    before = int(np.argmax(steps > 1.5))
    stamps = [simulator.sweep(index).truth.stamp_ns for index in (before, before + 1)]
    assert stamps == [FIRST_STAMP_NS + round(simulator.times_s[before + k] * 1e9) for k in (0, 1)]


def test_intervals_have_jitter():
    simulator = SweepSimulator(settings(1, "jitter"))
    steps = np.diff(simulator.times_s) / simulator.interval_s
    assert 0.001 < steps.std() < 0.02
    assert steps.mean() == pytest.approx(1.0, abs=0.002)


def test_the_own_body_stays_with_the_sensor_and_has_no_truth():
    simulator = first("body", drives)
    classes = [body.model.surface_class for body in simulator.scene.bodies]
    number = classes.index(SurfaceClass.OWN_BODY)
    own = simulator.scene.bodies[number]
    for sweep in map(simulator.sweep, (2, 9)):
        rows = np.flatnonzero(sweep.truth.class_id == SurfaceClass.OWN_BODY)
        assert len(rows) > 20
        assert (sweep.truth.object_id[rows] == number + 1).all()
        assert not sweep.truth.valid[rows].any()
        assert not sweep.truth.dynamic[rows].any()
        local = [
            signed_distance(
                shape.kind,
                shape.half_extents,
                apply(invert(shape.body_from_shape), sweep.xyz[rows].astype(float)),
            )
            for shape in own.model.shapes
        ]
        assert np.min(np.abs(local), axis=0).max() < 6 * simulator.scene.sensor.range_noise_m


def test_smooth_and_wet_surfaces_return_only_rays_near_their_normal():
    rng = np.random.default_rng(0)

    def share(degrees, smoothness, wetness):
        cosines = np.full(500, np.cos(np.radians(degrees)))
        light = reflectance(np.full(500, 60.0), np.full(500, smoothness), wetness, cosines)
        return are_returned(light, np.full(500, 30.0), 40.0, 0.0, rng).mean()

    assert share(0, 0.999, 0.0) == share(4, 0.999, 0.0) == 1.0
    assert share(40, 0.999, 0.0) < 0.01
    # A wall of plaster when dry, and when wet; leaves and clothes stay rough.
    assert share(60, 0.3, 0.0) > 0.99
    assert share(60, 0.3, 1.0) < 0.95 * share(60, 0.3, 0.0)
    assert share(60, 0.0, 1.0) > 0.99


def test_a_driving_sensor_sees_smooth_walls_only_squarely_and_dry_houses_at_any_angle():
    simulator = first("walls", lambda scene: drives(scene) and "; street" in scene.text)
    angles = {True: [], False: []}
    for sweep in map(simulator.sweep, (0, 10)):
        for number, body in enumerate(simulator.scene.bodies, 1):
            rows = np.flatnonzero(sweep.truth.object_id == number)
            if body.model.surface_class == SurfaceClass.BUILDING:
                wall_from_sensor = invert(body.placement) @ sweep.pose
                on_wall = apply(wall_from_sensor, sweep.xyz[rows].astype(float))
                rays = (on_wall - wall_from_sensor[:3, 3])[np.abs(on_wall[:, 0]) < 5.0]
                cosines = np.abs(rays[:, 1]) / np.linalg.norm(rays, axis=1)
                angles[body.model.smoothness > 0.99].extend(np.degrees(np.arccos(cosines)))
    assert np.quantile(angles[True], 0.99) < 50
    assert np.quantile(angles[False], 0.9) > 60


def test_returns_fade_in_fog():
    light, ranges = np.full(4000, 0.5), np.repeat([5.0, 40.0], 2000)
    rng = np.random.default_rng(0)
    clear, foggy = (are_returned(light, ranges, 60.0, loss, rng) for loss in (0.0, 0.03))
    assert clear.all()
    assert foggy[:2000].all()
    assert 0.1 < foggy[2000:].mean() < 0.9


@pytest.mark.parametrize(
    ("kind", "degrees"),
    [("16 beams", np.arange(-15, 16, 2)), ("32 beams", -30.67 + np.arange(32) * 4 / 3)],
)
def test_rings_are_those_of_real_lidars(kind, degrees):
    simulator = first("lidar", lambda scene: scene.text.startswith(kind))
    sweep = simulator.sweep(0)
    elevation = np.degrees(np.arcsin(sweep.xyz[:, 2] / np.linalg.norm(sweep.xyz, axis=1)))
    rings = np.unique(sweep.columns["ring"])
    assert len(rings) > len(degrees) / 2
    for ring in rings:
        middle = np.median(elevation[sweep.columns["ring"] == ring])
        assert middle == pytest.approx(degrees[ring], abs=0.05)


def test_a_rosette_around_the_lidar_sees_all_sides_and_does_not_repeat_itself():
    simulator = first(
        "lidar", lambda scene: scene.sensor.degrees == 360 and scene.sensor.is_rosette
    )
    one, other = (
        rays[0].azimuth for rays in (next(simulator.scene.sensor.rays(k, 0)) for k in (0, 1))
    )
    assert np.diff(one).max() < np.radians(5)
    assert np.intersect1d(one, other).size < 0.01 * len(one)


def test_people_touch_each_other_and_walls():
    scene = first("groups", lambda scene: "queue" in scene.text).scene
    people = [b for b in scene.bodies if b.model.surface_class == SurfaceClass.PEDESTRIAN]
    at = np.array([body.world_from_body(0.0)[:2, 3] for body in people])
    assert cKDTree(at).query(at, k=2)[0][:, 1].min() < 0.5
    texts = [build_scene(settings(seed, "groups")).text for seed in range(10)]
    assert any("pair at a wall" in text for text in texts)


def test_far_kerbs_are_met_by_single_rings():
    simulator = first("kerbs", lambda scene: scene.text.startswith("32 beams"))
    sweep = simulator.sweep(0)
    kerbs = [k for k, body in enumerate(simulator.scene.bodies, 1) if body.model.width_m == 0.3]
    far = np.hypot(*sweep.xyz[:, :2].T) > 10
    rings = [
        len(np.unique(sweep.columns["ring"][far & (sweep.truth.object_id == number)]))
        for number in kerbs
    ]
    assert np.median([number for number in rings if number]) == 1


@pytest.mark.parametrize(("scenario", "names"), [("random", "fog"), ("adverse", "fog,snow")])
def test_unknown_conditions_are_refused(scenario, names):
    with pytest.raises(SettingsError, match=f"conditions: got '{names}' with scenario={scenario}"):
        SimulationSettings(scenario=scenario, conditions=names)
