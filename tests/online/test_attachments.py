# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Fragments and cut-off bottoms: what goes with a mover, and what does not."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenes import SETTINGS, objects_of, prepared, rows, surface

from mnsf_ros.online.attachments import attached

CAR = surface((8.0, 0.0, 0.0), size=(3.9, 1.8, 1.2), num_points=3000)
# One empty cell of 0.25 m is between it and the end of the car at x = 9.95.
FRAGMENT = surface((10.35, 0.0, 0.0), size=(0.08, 0.2, 0.4), num_points=60)


def rows_of(*parts, is_loose=True, settings=SETTINGS):
    """(N,) what `attached` says if the first object moves and the others are loose."""
    current = prepared(*parts, settings=settings)
    objects, owners = objects_of(current), current.objects()
    first = objects.select(owners[:1] - 1)
    loose = np.full(current.num_objects, is_loose)
    loose[[0, *first.numbers]] = False
    return spread(attached(current, owners, first, loose), len(owners))


def spread(found, number):
    """(N,) the rows of the points found; -1 for all others."""
    points, mover_rows = found
    all_rows = np.full(number, -1)
    all_rows[points] = mover_rows
    return all_rows


WALL = surface((13.4, 0.0, 0.0), size=(6.0, 0.2, 1.0), num_points=3000)


@pytest.mark.parametrize(
    ("part", "is_loose", "row"),
    [
        (FRAGMENT, True, 0),
        (FRAGMENT + rows((0.5, 0, 0)), True, -1),
        (FRAGMENT, False, -1),
        (WALL, True, -1),
    ],
    ids=["near", "too far", "static for sure", "long, near at one end"],
)
def test_fragment_goes_with_the_mover_within_half_a_metre(part, is_loose, row):
    assert (rows_of(CAR, part, is_loose=is_loose)[len(CAR) :] == row).all()


def test_fragment_goes_with_the_nearer_of_two_movers():
    current = prepared(CAR, FRAGMENT, CAR + rows((4.9, 0, 0)))
    objects, owners = objects_of(current), current.objects()
    part = owners[len(CAR)]
    movers = objects.select(np.flatnonzero(objects.numbers != part))
    is_loose = np.arange(current.num_objects) == part
    found = spread(attached(current, owners, movers, is_loose), len(owners))
    nearer = movers.numbers.tolist().index(owners[0])
    assert (found[owners == part] == nearer).mean() > 0.9


class TestBottoms:
    """Points that were taken for ground: the car's bottom at 0.15 m, the road at 0 below it."""

    ROAD = rows(*((x, y, -0.8) for x in np.arange(5, 12, 0.2) for y in np.arange(-4, 4, 0.2)))
    BOTTOM = rows(*((x, 0.9, -0.65) for x in np.arange(6.2, 9.8, 0.1)))

    def found(self, road, bottom=BOTTOM, car=CAR):
        """The rows of the road's points and of the bottom's."""
        on_ground = SETTINGS.changed({"ground.remove": True})
        found = rows_of(car, road, bottom, settings=on_ground)
        return np.split(found, np.cumsum([len(car), len(road)]))[1:]

    @pytest.mark.parametrize("beside_m", [0.0, 1.2], ids=["road below", "road beside"])
    def test_the_bottom_goes_with_the_mover_and_the_road_does_not(self, beside_m):
        is_seen = np.abs(self.ROAD[:, 1]) >= beside_m
        road, bottom = self.found(self.ROAD[is_seen])
        assert (bottom == 0).all()
        assert (road == -1).all()

    def test_however_far_above_the_next_beam_is(self):
        _, bottom = self.found(self.ROAD, car=CAR[CAR[:, 2] > 0.2])
        assert (bottom == 0).mean() > 0.9

    def test_a_kerb_beside_the_mover_does_not(self):
        road, kerb = self.found(self.ROAD, self.BOTTOM + rows((0, 0.3, 0)))
        assert (kerb == -1).all()
        assert (road == -1).all()

    def test_on_a_road_that_rises_too(self):
        def raised(points):
            return points + np.float32(0.1) * (points[:, :1] - np.float32(8.5)) * rows((0, 0, 1))

        road, bottom = self.found(raised(self.ROAD), raised(self.BOTTOM))
        assert (bottom == 0).all()
        assert (road == -1).all()


def test_the_estimate_says_so():
    """A fragment too small to be an object gets the mover's motion."""
    from mnsf_ros.methods import make_method
    from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

    def sweep(index):
        still = [surface((x, y, 0.5), (1, 1, 2)) for x in (-9.0, 2.0, 16.0) for y in (-9.0, 9.0)]
        few = FRAGMENT[:4]
        moved = [part + rows((0.8 * index, 0, 0)) for part in (CAR, few)]
        xyz = np.concatenate([*moved, *still]).astype(np.float32)
        return Sweep(xyz, 10**9 + index * 10**8, "lidar", odometry=np.eye(4))

    settings = SETTINGS.changed({"ego_motion.source": "odometry"})
    triplet = SweepTriplet(*(sweep(index) for index in range(3)))
    result = make_method("online", settings).estimate(triplet)
    fragment = slice(len(CAR), len(CAR) + 4)
    assert result.over_ground.dynamic[fragment].all()
    assert result.over_ground.motion[fragment] == pytest.approx(
        rows((0.8, 0, 0)).repeat(4, 0), abs=0.05
    )
    assert not result.over_ground.dynamic[len(CAR) + 4 :].any()
