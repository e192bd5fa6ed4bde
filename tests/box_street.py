# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A street of boxes on flat ground, seen from a sensor whose poses are known."""

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

SENSOR_HEIGHT_M = 1.8
FIRST_STAMP_NS = 10**10
INTERVAL_NS = 10**8

CAR = (4.0, 1.8, 1.5)


def pose(x=0.0, y=0.0, z=0.0, yaw_deg=0.0, pitch_deg=0.0):
    """(4, 4) world_from_sensor, or any other pose."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("ZY", (yaw_deg, pitch_deg), degrees=True).as_matrix()
    matrix[:3, 3] = x, y, z
    return matrix


def stamp_ns(index):
    """Stamp of a sweep by its number, of ten in a second."""
    return FIRST_STAMP_NS + round(index * INTERVAL_NS)


def box_points(rng, center, size, num_points):
    """(N, 3) points on the walls and the roof of a box that stands on the ground."""
    points = rng.uniform(-0.5, 0.5, (num_points, 3))
    rows, axes = np.arange(num_points), rng.choice(3, num_points, p=(0.4, 0.4, 0.2))
    points[rows, axes] = np.where(axes == 2, 0.5, np.copysign(0.5, points[rows, axes]))
    return points * size + (center[0], center[1], size[2] / 2)


class BoxStreet:
    """Parked boxes and house walls along the x axis; other points of them in each sweep.

    Of a car that is added the points are always the same, so that its motion is exact.
    """

    def __init__(self, seed=0, num_parked=16):
        rng = np.random.default_rng(seed)
        self.boxes = []
        for number in range(num_parked):
            x, side = rng.uniform(-35, 35), (-1) ** number
            size = rng.uniform((0.5, 0.5, 1.0), (4.5, 2.0, 3.0))
            self.boxes.append(((x, side * rng.uniform(6, 10)), size))
        for side in (-1, 1):
            for x in (-25, 0, 25):
                self.boxes.append(((x + rng.uniform(-1, 1), 13 * side), (20.0, 3.0, 5.0)))

    def xyz(self, world_from_sensor, seed=0, cars=(), points_per_box=400):
        """(N, 3) float32, sensor frame; the points of the cars are the last ones.

        Args:
            world_from_sensor: (4, 4), over the ground at `SENSOR_HEIGHT_M`.
            seed: Which points of the surfaces.
            cars: (x, y) of the middles of further boxes, `CAR` large.
            points_per_box: Of each box.
        """
        rng = np.random.default_rng(seed)
        parts = [rng.uniform((-40, -12, 0), (40, 12, 0), (6000, 3))]
        parts += [box_points(rng, *box, points_per_box) for box in self.boxes]
        rigid = np.random.default_rng(1)
        parts += [box_points(rigid, center, CAR, points_per_box) for center in cars]
        points = np.concatenate(parts) - (0, 0, SENSOR_HEIGHT_M)
        sensor_from_world = np.linalg.inv(world_from_sensor)
        seen = points @ sensor_from_world[:3, :3].T + sensor_from_world[:3, 3]
        return seen.astype(np.float32)

    def sweep(self, world_from_sensor, index=0.0, frame_id="lidar", odometry=None, **how):
        """A sweep by its number, whose points are its own."""
        xyz = self.xyz(world_from_sensor, seed=round(10 * index) + 1000, **how)
        return Sweep(xyz, stamp_ns(index), frame_id, odometry=odometry)

    def bent_sweep(self, path, index, first_s=0.0, columns=400):
        """A sweep of a sensor that turns clockwise while it moves.

        Args:
            path: Number of a sweep, also between two, to the pose of the sensor.
            index: Number of the sweep.
            first_s: Seconds from its stamp to its first point, which is behind the sensor.
            columns: Times that points are measured at.

        Returns:
            The sweep, and where its points were at the stamp: (N, 3) metres.
        """
        straight = self.xyz(path(index), seed=round(10 * index) + 1000).astype(np.float64)
        turns = 0.5 - np.arctan2(straight[:, 1], straight[:, 0]) / (2 * np.pi)
        column = np.minimum((turns * columns).astype(int), columns - 1)
        column_s = first_s + (np.arange(columns) + 0.5) / columns * INTERVAL_NS / 1e9
        then = [path(index + time_s / (INTERVAL_NS / 1e9)) for time_s in column_s]
        moved = np.array([np.linalg.inv(place) @ path(index) for place in then])[column]
        xyz = np.einsum("nij,nj->ni", moved[:, :3, :3], straight) + moved[:, :3, 3]
        times_s = column_s[column].astype(np.float32)
        return Sweep(xyz.astype(np.float32), stamp_ns(index), "lidar", times_s=times_s), straight


def unrelated_sweep(index, num_points=8000):
    """Points anywhere: nothing of the street."""
    rng = np.random.default_rng(round(10 * index))
    xyz = rng.uniform((-40, -40, -2), (40, 40, 20), (num_points, 3)).astype(np.float32)
    return Sweep(xyz, stamp_ns(index), "lidar")


def triplets_of(sweeps):
    """All triplets of consecutive sweeps."""
    return [SweepTriplet(*sweeps[first : first + 3]) for first in range(len(sweeps) - 2)]


def distance_m(pose_a, pose_b):
    """Between two positions."""
    return float(np.linalg.norm(pose_a[:3, 3] - pose_b[:3, 3]))


def angle_deg(pose_a, pose_b):
    """Between two orientations."""
    turn = Rotation.from_matrix(pose_a[:3, :3].T @ pose_b[:3, :3])
    return float(np.degrees(turn.magnitude()))
