# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How a lidar is mounted: by parameters, by its sweeps, and by the ground that it sees."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from box_street import SENSOR_HEIGHT_M, BoxStreet, pose
from hall import hall
from scipy.spatial.transform import Rotation

from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.mounting import Mounting
from mnsf_ros.sweeps.mounting_estimate import MountingEstimate
from mnsf_ros.sweeps.sweep import Sweep

LEVEL = BoxStreet().sweep(pose())


def turned(roll_deg=0.0, pitch_deg=0.0, shift=(0.0, 0.0, 0.0)):
    """The sweep of a lidar that is mounted so, and (4, 4) sensor_from_level."""
    sensor_from_level = np.eye(4)
    mount = Rotation.from_euler("YX", (pitch_deg, roll_deg), degrees=True)
    sensor_from_level[:3, :3], sensor_from_level[:3, 3] = mount.as_matrix().T, shift
    xyz = LEVEL.xyz @ sensor_from_level[:3, :3].T + np.float32(shift)
    return replace(LEVEL, xyz=np.asarray(xyz, np.float32)), sensor_from_level


def mounted(sweep, estimate=None, **changes):
    changes = {name.replace("__", "."): value for name, value in changes.items()}
    return (estimate or MountingEstimate()).mounted(sweep, Settings().changed(changes))


@pytest.mark.parametrize("mount", [(0, 0), (4, 0), (0, -4), (2, 3)])
def test_a_frame_that_is_nearly_level_stays_the_very_same(mount):
    sweep = turned(*mount)[0]
    assert mounted(sweep) is sweep
    assert sweep.levelled is sweep


@pytest.mark.parametrize(
    "mount", [(180, 0), (0, 180), (8, 0), (0, -20), (45, 0), (0, 45), (-30, 35), (160, 20)]
)
def test_the_ground_shows_a_tilted_mount(mount):
    sweep = mounted(turned(*mount)[0])
    normal = sweep.levelled.xyz - LEVEL.xyz
    assert np.abs(normal[:, 2]).max() < 0.03 * 45  # height to .03 of the distance
    assert sweep.levelled is sweep.levelled
    assert sweep.levelled.tilt is None


def test_upside_down_forward_stays_forward():
    level = mounted(turned(180)[0]).levelled
    np.testing.assert_allclose(level.xyz, LEVEL.xyz, atol=0.03 * 45)


@pytest.mark.parametrize("group", ["lidar_1.", "ego_motion.sensor_"])
def test_parameters_say_it_exactly(group):
    sweep, _ = turned(roll_deg=170, pitch_deg=8)
    level = mounted(sweep, **{f"{group}roll_deg": 170.0, f"{group}pitch_deg": 8.0}).levelled
    np.testing.assert_allclose(level.xyz[:, 2], LEVEL.xyz[:, 2], atol=1e-4)


def test_the_lens_is_where_parameters_say_in_the_frame_of_the_robot():
    sweep, _ = turned(shift=(1.4, 0.5, 1.8))
    found = mounted(
        sweep, lidars__frame="lidar", lidar_1__x_m=1.4, lidar_1__y_m=0.5, lidar_1__z_m=1.8
    )
    np.testing.assert_allclose(found.levelled.xyz, LEVEL.xyz, atol=1e-5)


@pytest.mark.parametrize("shift", [(1.4, 0.0, 1.8), (8.0, 0.8, 2.9)])
@pytest.mark.parametrize("roll_deg", [0.0, 180.0])
def test_beams_show_the_lens(roll_deg, shift):
    sweep, _ = turned(roll_deg=roll_deg, shift=shift)
    elevations = np.arctan2(LEVEL.xyz[:, 2], np.hypot(LEVEL.xyz[:, 0], LEVEL.xyz[:, 1]))
    rings = SimpleNamespace(rings=np.round(np.degrees(elevations) * 5).astype(int))
    level = mounted(replace(sweep, source=rings)).levelled
    np.testing.assert_allclose(level.xyz, LEVEL.xyz, atol=0.1 if roll_deg == 0 else 0.03 * 45)


def test_the_height_over_ground_is_known():
    estimate = MountingEstimate()
    mounted(turned(shift=(0.0, 0.0, 1.8))[0], estimate)
    assert estimate.ground[3] == pytest.approx(SENSOR_HEIGHT_M - 1.8, abs=0.05)
    mounted(replace(LEVEL, frame_id="other"), estimate)
    assert estimate.ground[3] == pytest.approx(SENSOR_HEIGHT_M, abs=0.05)


def test_parameters_come_before_the_sweep_and_that_before_the_ground():
    sweep, _ = turned(roll_deg=180)
    by_tf = Mounting.of(np.array([0.0, 0.3, -1.0]), np.zeros(3), "by TF")
    told = replace(sweep, mounting=by_tf)
    assert mounted(told).mounting is by_tf
    assert "by parameters" in str(mounted(told, lidar_1__roll_deg=180.0).mounting)
    assert "from the ground" in str(mounted(sweep).mounting)


def test_parameters_may_say_that_it_is_level():
    sweep, _ = turned(roll_deg=180)
    assert mounted(sweep, lidars__poses="parameters") is sweep


def test_it_is_kept_until_frame_or_parameters_change():
    estimate, (sweep, _) = MountingEstimate(), turned(roll_deg=180)
    first = mounted(sweep, estimate).mounting
    assert mounted(LEVEL, estimate).mounting is first
    assert mounted(LEVEL, estimate, lidar_1__roll_deg=50.0).mounting is not first
    assert mounted(replace(LEVEL, frame_id="other"), estimate).mounting is None


def test_without_ground_it_is_looked_for_again():
    estimate = MountingEstimate()
    few = Sweep(np.ones((5, 3), np.float32), frame_id="lidar")
    assert all(mounted(few, estimate) is few for _ in range(7))
    assert "unknown" in estimate.text
    assert mounted(turned(roll_deg=180)[0], estimate).tilt is not None


@pytest.mark.parametrize("value", [0.0, 1e30, -1e-30])
def test_any_finite_points_have_no_ground_or_some(value):
    sweep = Sweep(np.full((2000, 3), value, np.float32))
    assert mounted(sweep).tilt is None


@pytest.mark.parametrize("view", [(16, 15.0), (32, 25.0), (64, 22.0), (128, 45.0)])
@pytest.mark.parametrize("size", [(60, 2, 2.6), (60, 1.6, 2.6), (60, 2, 3.5), (30, 12, 4.0)])
def test_the_larger_walls_of_a_corridor_are_not_taken_for_the_floor(view, size):
    xyz, _ = hall((-20.0 if size[0] == 60 else 0.0, 0.0), size, *view)
    estimate = MountingEstimate()
    sweep = Sweep(xyz, frame_id="lidar")
    assert mounted(sweep, estimate) is sweep
    assert estimate.found.is_level
