# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The tiny world through the range images of two lidars, as Waymo Open has it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import tiny_world
from scipy.spatial.transform import Rotation

NUM_COLUMNS = 720
NO_LABELS = 3
# The lidar on the roof is turned; the one at the front is tilted, too.
MOUNTS = {1: tiny_world.pose(1.4, 0.0, 2.2, 2.6), 2: tiny_world.pose(4.0, 0.1, 0.7, 0.05)}
MOUNTS[2][:3, :3] = MOUNTS[2][:3, :3] @ Rotation.from_euler("y", 0.1).as_matrix()
SWEEP = {"num_points": 8, "ground_step": 4.0}


@dataclass
class Image:
    """A range image (H, W, 4), angles (H) from the lowest row up, poses (H, W, 6) or None.

    `points` (N, 3) are those in the vehicle frame, in the order of the pixels, and `part` (N,)
    what they are.
    """

    image: np.ndarray
    inclinations: np.ndarray
    poses: np.ndarray | None
    points: np.ndarray
    part: np.ndarray


def vehicle_pose_of_pixel(index, column):
    """Roll, pitch, yaw, x, y, z of the vehicle in the world while a column was measured."""
    world = tiny_world.world_from_sweep(index)
    late = column / NUM_COLUMNS - 0.5
    yaw = math.atan2(world[1, 0], world[0, 0])
    x, y, z = world[:3, 3]
    return np.array([0.01, -0.02, yaw + 0.03 * late, x + 0.8 * late, y, z + 0.05], np.float32)


def matrix_of(roll_to_z):
    roll, pitch, yaw, x, y, z = (float(value) for value in roll_to_z)
    turns = [
        Rotation.from_euler(axis, angle).as_matrix()
        for axis, angle in (("z", yaw), ("y", pitch), ("x", roll))
    ]
    matrix = np.eye(4)
    matrix[:3, :3] = turns[0] @ turns[1] @ turns[2]
    matrix[:3, 3] = x, y, z
    return matrix


def images():
    """The images of both lidars, sweep by sweep."""
    pixels = {laser: all_pixels(laser) for laser in MOUNTS}
    return [
        [assembled(index, laser, pixels[laser]) for laser in MOUNTS]
        for index in range(tiny_world.NUM_SWEEPS)
    ]


def all_pixels(laser):
    """(angle, sweep, column, range, part) of half of all points, from the highest down.

    Each point of any sweep has a row of its own, because all sweeps share one calibration, and
    is moved to the middle of the nearest column.
    """
    pixels = []
    for index in range(tiny_world.NUM_SWEEPS):
        tiny = tiny_world.sweep(index, **SWEEP)
        for point, part in list(zip(tiny.xyz.astype(float), tiny.part, strict=True))[
            laser - 1 :: 2
        ]:
            column = 0
            for _ in range(3):  # the pose depends on the column, and the column on the pose
                to_vehicle = to_vehicle_of(index, laser, column)
                x, y, z = tiny_world.carried(np.linalg.inv(to_vehicle), point)
                azimuth = math.atan2(y, x) + mount_yaw(laser)
                azimuth = (azimuth + math.pi) % (2 * math.pi) - math.pi
                column = int((math.pi - azimuth) / (2 * math.pi) * NUM_COLUMNS) % NUM_COLUMNS
            distance = np.float32(math.sqrt(x * x + y * y + z * z))
            pixels.append((math.asin(z / distance), index, column, distance, part))
    return sorted(pixels, key=lambda pixel: -pixel[0])


def assembled(index, laser, all_pixels):
    image = np.zeros((len(all_pixels), NUM_COLUMNS, 4), np.float32)
    image[:, :, 0] = -1
    points, part = [], []
    for row, (inclination, sweep, column, distance, what) in enumerate(all_pixels):
        if sweep != index:
            continue
        image[row, column] = distance, 0.5, 0.25 * laser, -1
        azimuth = math.pi - (column + 0.5) / NUM_COLUMNS * 2 * math.pi - mount_yaw(laser)
        local = float(distance) * np.array(
            [
                math.cos(inclination) * math.cos(azimuth),
                math.cos(inclination) * math.sin(azimuth),
                math.sin(inclination),
            ]
        )
        points.append(tiny_world.carried(to_vehicle_of(index, laser, column), local))
        part.append(what)
    poses = None
    if laser == 1:
        columns = np.array([vehicle_pose_of_pixel(index, c) for c in range(NUM_COLUMNS)])
        poses = np.broadcast_to(columns, (*image.shape[:2], 6)).astype(np.float32)
    inclinations = np.array([pixel[0] for pixel in all_pixels])[::-1]
    return Image(image, inclinations, poses, np.array(points), np.array(part))


def mount_yaw(laser):
    return math.atan2(MOUNTS[laser][1, 0], MOUNTS[laser][0, 0])


def to_vehicle_of(index, laser, column):
    """(4, 4) from the lidar to the vehicle frame of the sweep."""
    if laser != 1:
        return MOUNTS[laser]
    moved = matrix_of(vehicle_pose_of_pixel(index, column))
    return np.linalg.inv(tiny_world.world_from_sweep(index)) @ moved @ MOUNTS[laser]


def check(path, images):
    """Compares a recording with the images (one list of two for each sweep) it is made from."""
    found = tiny_world.read(path)
    assert found.stamps == [tiny_world.stamp_ns(index) for index in range(tiny_world.NUM_SWEEPS)]
    assert found.frames == {"vehicle"}
    for index, lasers in enumerate(images):
        xyz = np.vstack([laser.points for laser in lasers])
        part = np.concatenate([laser.part for laser in lasers])
        np.testing.assert_allclose(found.xyz[index], xyz, atol=1e-4)
        tiny_world.check_truth(found.truth[index], index, xyz, part)
        np.testing.assert_allclose(
            found.poses[found.stamps[index]], tiny_world.world_from_sweep(index), atol=1e-9
        )
        columns = found.columns[index]
        assert columns["laser"].tolist() == sorted(columns["laser"])
        assert np.array_equal(columns["elongation"], 0.25 * columns["laser"])
        assert set(columns["intensity"]) == {0.5}
    return found
