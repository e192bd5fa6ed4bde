# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Clouds that are parts of a revolution are put together; whole ones stay as they are."""

from dataclasses import replace

import numpy as np
import pytest

from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.revolutions import Revolutions
from mnsf_ros.sweeps.sweep import Sweep

BUFFER = Settings().buffer


def cloud(from_deg, to_deg, stamp_s, num_points=3000, frame_id="lidar"):
    """Points in some directions, at random."""
    random = np.random.default_rng(round(1e4 * stamp_s))
    azimuths = np.radians(random.uniform(from_deg, to_deg, num_points))
    ranges, heights = random.uniform(2, 50, num_points), random.uniform(-2, 2, num_points)
    xyz = np.stack([ranges * np.cos(azimuths), ranges * np.sin(azimuths), heights], axis=1)
    return Sweep(xyz.astype(np.float32), round(1e9 * (1 + stamp_s)), frame_id)


def turning(sizes_deg, num_clouds, num_points=3000):
    """Clouds of a lidar that turns with 10 Hz, with sectors of these sizes in turn."""
    angle_deg = 0.0
    for number in range(num_clouds):
        size_deg = sizes_deg[number % len(sizes_deg)]
        yield cloud(angle_deg, angle_deg + size_deg, angle_deg / 3600, num_points)
        angle_deg += size_deg


def groups_of(clouds):
    revolutions = Revolutions()
    return [parts for each in clouds for parts in revolutions.add(each, BUFFER)]


@pytest.mark.parametrize(
    ("from_deg", "to_deg", "num_points"),
    [(0, 360, 3000), (-35, 35, 3000), (0, 360, 250), (0, 360, 60), (0, 9, 5)],
)
def test_whole_clouds_go_on_at_once(from_deg, to_deg, num_points):
    clouds = [cloud(from_deg, to_deg, 0.1 * number, num_points) for number in range(6)]
    assert groups_of(clouds) == [[each] for each in clouds]


def test_whole_clouds_of_few_columns_go_on_at_once():
    clouds = []
    for number in range(6):
        azimuths = np.radians(np.repeat(np.arange(90), 16) * 4.0 + number)
        xyz = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(1440)], axis=1)
        clouds.append(Sweep(xyz.astype(np.float32), number * 10**8))
    assert groups_of(clouds) == [[each] for each in clouds]


def test_first_cloud_of_a_driver_may_be_a_piece():
    clouds = [cloud(200, 360, 0.0), *(cloud(0, 360, 0.1 * n) for n in range(1, 4))]
    assert groups_of(clouds) == [[each] for each in clouds]


@pytest.mark.parametrize("num_points", [3000, 300])
@pytest.mark.parametrize(
    "sizes_deg", [[36.0], [180.0], [300.0, 60.0], [90.0, 30.0, 240.0], [4.0, 20.0]]
)
def test_parts_are_put_together(sizes_deg, num_points):
    clouds = list(turning(sizes_deg, round(5 * 360 / np.mean(sizes_deg)), num_points))
    first, gap, *groups = groups_of(clouds)
    assert first == clouds[:1]
    assert gap == []
    assert len(groups) >= 3
    num_parts = round(360 / np.mean(sizes_deg))
    assert all(len(parts) == num_parts for parts in groups)
    assert [part for parts in groups for part in parts] == clouds[1 : 1 + num_parts * len(groups)]


def test_the_origin_may_be_metres_from_the_lens():
    clouds = []
    for part in turning([36.0], 40):
        ranges = np.linalg.norm(part.xyz, axis=1, keepdims=True)
        moved = part.xyz * ranges / 50 + np.float32([4.0, 0.5, 1.9])  # most points are near
        clouds.append(replace(part, xyz=moved))
    assert {len(parts) for parts in groups_of(clouds)[2:]} == {10}


def test_parts_that_do_not_divide_a_revolution():
    groups = groups_of(turning([100.0], 30))[2:]
    assert {len(parts) for parts in groups} <= {3, 4}


def test_a_lost_part_and_one_that_sees_nothing_cost_no_revolution():
    clouds = list(turning([36.0], 50))
    del clouds[17]
    clouds[34] = Sweep(clouds[34].xyz[:3], clouds[34].stamp_ns, "lidar")
    groups = groups_of(clouds)[2:]
    assert [len(parts) for parts in groups][:3] == [10, 9, 10]


def test_whole_clouds_that_become_parts_and_back():
    whole = [cloud(0, 360, 0.1 * number) for number in range(3)]
    parts = list(turning([90.0], 24))
    revolutions = Revolutions()
    sizes = [len(g) for each in (*whole, *parts, *whole) for g in revolutions.add(each, BUFFER)]
    assert sizes[:3] == [1, 1, 1]
    assert sizes.count(4) >= 4
    assert sizes[-2:] == [1, 1]


def test_a_gap_and_another_frame_end_a_revolution():
    clouds = list(turning([36.0], 16))
    late = cloud(216, 252, 3.0)
    other = cloud(252, 288, 3.01, frame_id="other")
    groups = groups_of([*clouds, late, other])[2:]
    assert [len(parts) for parts in groups] == [10, 5, 1, 1]
