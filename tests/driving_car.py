# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A car that drives along the street of boxes while the sensor does, too, and its exact flow."""

import numpy as np
from box_street import BoxStreet, pose

from mnsf_ros.geometry.rigid_motion import rigid_flow

STREET = BoxStreet()
POINTS_PER_CAR = 400
# Over the ground, metres per tenth of a second.
FAST = (0.8, 0.05, 0.0)


def path(index):
    """The sensor's pose at a sweep."""
    return pose(0.6 * index, yaw_deg=1.0 * index)


def sweep(index, velocity=FAST, **how):
    """A sweep; the points of the car are the last ones."""
    car = np.array([8.0, -2.0]) + index * np.asarray(velocity)[:2]
    return STREET.sweep(path(index), index, cars=[car], points_per_box=POINTS_PER_CAR, **how)


def is_of_car(sweep):
    """(N,) all points of the car."""
    return np.arange(len(sweep)) >= len(sweep) - POINTS_PER_CAR


def of_car(sweep):
    """(N,) the points of the car that are too high above the road for ground."""
    return is_of_car(sweep) & (sweep.xyz[:, 2] > -1.4)


def truth(index, next_index, sweep, velocity=FAST):
    """(N, 3) true flow and true motion over ground."""
    motion = np.zeros((len(sweep), 3))
    motion[of_car(sweep)] = (next_index - index) * np.asarray(velocity) @ path(index)[:3, :3]
    next_from_current = np.linalg.inv(path(next_index)) @ path(index)
    return rigid_flow(sweep.xyz + motion, next_from_current) + motion, motion
