# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Kinds of movers, on movers whose motion is known."""

import numpy as np
import pytest

from mnsf_ros.evaluation.movers import TrueMotion
from mnsf_ros.recording.flow_truth import SurfaceClass

# A box of 4 x 2 x 1 m, 10 m ahead.
CAR = np.stack(np.meshgrid(*(np.linspace(-n, n, 9) for n in (2, 1, 0.5))), -1).reshape(-1, 3)
CENTER = np.array([10.0, 0.0, 1.0])
CAR += CENTER
SMALL = 0.1 * (CAR - CENTER) + CENTER
X, Y = np.eye(3)[:2]


def points(xyz, velocity=(0, 0, 0), number=1, kind=SurfaceClass.CAR):
    return np.float32(xyz), np.broadcast_to(np.float64(velocity), xyz.shape), number, kind


def turning(xyz, rate_rad_s):
    """Exactly rigid until 0.1 s later, not only at first order."""
    x, y, _ = (xyz - xyz.mean(axis=0)).T
    change = (x + 1j * y) * (np.exp(0.1j * rate_rad_s) - 1) / 0.1
    return np.stack([8 + change.real, change.imag, 0 * x], axis=1)


def kinds_of(load, *parts):
    """Number of each mover to its kinds."""
    sizes = [len(part[0]) for part in parts]
    xyz, velocity = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    number, kind = (np.repeat([part[i] for part in parts], sizes) for i in (2, 3))
    dynamic = np.linalg.norm(velocity, axis=1) > 0.5
    truth = TrueMotion(xyz, velocity, dynamic, kind.astype(np.uint8), number, 0.1)
    found = load("mover_kinds").mover_kinds(truth)
    return {int(number[own[0]]): kinds for own, kinds in found}


@pytest.mark.parametrize(
    ("xyz", "velocity", "kinds"),
    [
        (CAR, (8, 0, 0), {"plain"}),
        (CAR, turning(CAR, 0.1), {"plain"}),
        (CAR, turning(CAR, 1.0), {"turning"}),
        # The turn of a thing this small cannot be seen.
        (SMALL, turning(SMALL, 1.0), {"plain"}),
        # Both halves go apart by 0.1 m.
        (CAR, (8 + 0.5 * np.sign(CAR - CENTER)) * X, {"bending"}),
    ],
)
def test_kinds_of_motion(load, xyz, velocity, kinds):
    assert kinds_of(load, points(xyz, velocity)) == {1: kinds}


@pytest.mark.parametrize(
    ("distance_m", "kind", "kinds"),
    [
        (0.2, SurfaceClass.BUILDING, {"touching"}),
        (0.4, SurfaceClass.BUILDING, {"plain"}),
        (0.0, SurfaceClass.ROAD, {"plain"}),
    ],
)
def test_only_what_is_close_and_above_the_ground_touches(load, distance_m, kind, kinds):
    other = points(CAR + (4 + distance_m) * X, number=0, kind=kind)
    assert kinds_of(load, points(CAR, (8, 0, 0)), other) == {1: kinds}


def test_pedestrians_side_by_side_are_a_crowd(load):
    people = [
        points(SMALL + y * Y, (1, 0, 0), number, SurfaceClass.PEDESTRIAN)
        for number, y in ((1, 0), (2, 0.8), (3, 5))
    ]
    expected = {1: {"crowds"}, 2: {"crowds"}, 3: {"plain"}}
    assert kinds_of(load, *people) == expected


def test_movers_that_are_small_far_away_or_static_do_not_count(load):
    parts = [points(CAR[:19], (8, 0, 0)), points(CAR + 45 * X, (8, 0, 0), 2)]
    assert kinds_of(load, *parts, points(CAR - 30 * X, number=3)) == {}
