# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What tracks predict of the objects of a later sweep."""

from __future__ import annotations

from itertools import count

import numpy as np
import pytest
from box_street import BoxStreet, pose
from small_scenes import moved_by, rows, table_of

from mnsf_ros.online.object_points import ObjectPoints
from mnsf_ros.online.preparation import Preparation
from mnsf_ros.online.tracker import Measurements, Tracker, track_prior
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet

STREET = BoxStreet()
SETTINGS = Settings()


def sweep(index, **how):
    return STREET.sweep(pose(0.5 * index, yaw_deg=2 * index), index, points_per_box=100, **how)


class Seen:
    """A tracker, and the sweeps that it is about."""

    def __init__(self, settings=SETTINGS):
        self.tracker = Tracker(settings.warm_start, count(1))
        self._preparation = Preparation(settings)

    def ready(self, index):
        """A sweep made ready."""
        pair = SweepTriplet(None, sweep(index), sweep(index + 0.01))
        return self._preparation.prepare(pair).of_triplet[0]


def object_at(*centers):
    """Objects with one point each, in the frame of the current sweep."""
    number = len(centers)
    owners = np.arange(number)
    return ObjectPoints(owners + 1, rows(*centers), owners, np.zeros(number, np.float32))


def followed(tracker, current, objects, motions, interval_s):
    """The tracks, and the track of each object, after objects were seen to move."""
    groups = np.arange(len(objects))
    table = table_of(objects, moving=moved_by(motions), residual_rise=1.0, groups=groups)
    measured = Measurements.of(table, current.pose.world_from_sensor, interval_s or 0.1)
    stamp_ns = current.sweep.stamp_ns
    tracks = tracker.predicted(stamp_ns, interval_s)
    return tracker.update(tracks, measured, stamp_ns, interval_s)


class TestExpected:
    def expected(self, *centers, index=6, interval_s=0.1):
        """After an object at (5, 1, 0) moved by (1, 0, 0) in the tenth after sweep 5."""
        seen = Seen()
        current = seen.ready(5)
        followed(seen.tracker, current, object_at((5, 1, 0)), rows((1, 0, 0)), 0.1)
        self.world_from_first = current.pose.world_from_sensor
        later = seen.ready(index)
        self.sensor_from_first = np.linalg.inv(later.pose.world_from_sensor) @ (
            self.world_from_first
        )
        places = [
            self.sensor_from_first[:3, :3] @ center + self.sensor_from_first[:3, 3]
            for center in centers
        ]
        tracks = seen.tracker.predicted(later.sweep.stamp_ns, interval_s)
        pose = later.pose.world_from_sensor
        return track_prior(tracks, object_at(*places), pose, interval_s).motions

    def test_motion_goes_on_in_the_frame_of_the_later_sweep(self):
        found = self.expected((6, 1, 0), (9, 9, 0))
        turn = self.sensor_from_first[:3, :3]
        np.testing.assert_allclose(found, [turn @ (1, 0, 0), (0, 0, 0)], atol=1e-5)

    def test_object_is_looked_for_where_it_should_be_by_now(self):
        assert self.expected((8, 1, 0), index=8).any()
        assert not self.expected((5, 1, 0), index=8).any()

    def test_motion_is_in_proportion_to_the_interval(self):
        found = self.expected((6, 1, 0), interval_s=0.25)
        assert np.linalg.norm(found) == pytest.approx(2.5, abs=1e-4)

    @pytest.mark.parametrize(("away_m", "is_same"), [(0.4, True), (0.6, False)])
    def test_object_is_the_same_within_half_a_metre(self, away_m, is_same):
        assert self.expected((6, 1 + away_m, 0)).any() == is_same
