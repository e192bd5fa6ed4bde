# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Movers without the distortion by their own motion, against the exact bodies of a simulation."""

import numpy as np
import pytest

from mnsf_ros.geometry.transforms import apply, invert
from mnsf_ros.settings import Settings
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps_io.movers_at_stamp import movers_at_stamp

NUM_SWEEPS = 9
LEAST_POINTS, MOST_POINTS = 80, 500
# Of the world: a car at 9.6 m/s, of which one side is measured first and the other last.
FAST_CAR = 106


class Scene:
    """The last but one of some simulated sweeps, with its estimate and its bodies."""

    def __init__(self):
        self.simulator = SweepSimulator(SimulationSettings(seed=715, scenario="random"))
        stream = Stream(Settings())
        for number in range(NUM_SWEEPS):
            true = self.simulator.sweep(number)
            times_s = (true.columns["t"] * 1e-9).astype(np.float32)
            sweep = Sweep(true.xyz, true.truth.stamp_ns, "lidar", times_s=times_s)
            self.estimate = stream.push(sweep)
        self.triplet = stream.triplet
        self.bodies = self.simulator.sweep(NUM_SWEEPS - 2).truth.object_id

    def in_body(self, number, points, sweep=NUM_SWEEPS - 2, after_s=0.0):
        """Points of the frame of the sensor at a time in that of a body at that time."""
        time_s = self.simulator.times_s[sweep] + after_s
        ego = self.simulator.scene.ego.world_from_sensor(time_s)
        body = self.simulator.scene.bodies[number - 1].world_from_body(time_s)
        return apply(invert(body) @ ego, points.astype(np.float64))

    def true_places(self, number, rows):
        """Points of a body, measured at different times, in its own frame."""
        sweep = self.triplet.current
        return np.concatenate(
            [
                self.in_body(number, sweep.xyz[row : row + 1], after_s=sweep.times_s[row])
                for row in rows
            ]
        )


@pytest.fixture(scope="module")
def scene():
    return Scene()


def test_each_point_is_where_it_was_at_the_stamp(scene):
    sweep, known = scene.triplet.current, scene.estimate.over_ground
    moved, estimate = movers_at_stamp(
        sweep, scene.estimate, known, scene.triplet.interval_s, deskew=True
    )
    np.testing.assert_array_equal(moved[~known.dynamic], sweep.xyz[~known.dynamic])
    errors_m = {}
    for number in np.unique(scene.bodies[known.dynamic]):
        rows = np.flatnonzero(known.dynamic & (scene.bodies == number))
        if number == 0 or len(rows) < LEAST_POINTS:
            continue
        # A part may be a track of its own, with another motion.
        tracks = known.track_ids[rows]
        rows = rows[tracks == np.bincount(tracks).argmax()]
        rows = rows[:: 1 + len(rows) // MOST_POINTS]
        true = scene.true_places(number, rows)
        before, after = (scene.in_body(number, xyz[rows]) for xyz in (sweep.xyz, moved))
        following = scene.in_body(number, (moved + estimate.flow)[rows], NUM_SWEEPS - 1)
        errors_m[number] = [
            np.linalg.norm(found - true, axis=1).mean() for found in (before, after, following)
        ]
        if number == FAST_CAR:
            width_m, distorted_m, undistorted_m = (
                np.ptp(found[:, 1]) for found in (true, before, after)
            )
    assert len(errors_m) > 10
    measured, at_stamp, next_stamp = np.median(list(errors_m.values()), axis=0)
    assert at_stamp < measured / 4
    assert at_stamp < 0.025
    assert next_stamp < 0.05
    assert abs(distorted_m - width_m) > 0.1
    assert abs(undistorted_m - width_m) < 0.04


def test_clouds_of_a_driver_that_corrects_them_move_by_the_mover_only(scene):
    known, interval_s = scene.estimate.over_ground, scene.triplet.interval_s
    sweep = scene.triplet.current
    moved, _ = movers_at_stamp(sweep, scene.estimate, known, interval_s, deskew=False)
    shifts = -known.motion / interval_s * sweep.times_s[:, None]
    np.testing.assert_allclose((moved - sweep.xyz)[known.dynamic], shifts[known.dynamic], atol=1e-4)
