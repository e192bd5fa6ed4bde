# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Simulated sweeps as a turning lidar measures them: each point at its own time, exact truth."""

from dataclasses import dataclass

import numpy as np

from mnsf_ros.geometry.transforms import invert
from mnsf_ros.recording.flow_truth import TrueSweep
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.sweeps.sweep import Sweep

_COLUMNS = 500


@dataclass(frozen=True)
class BentSweep:
    """A sweep, its truth, and what it was simulated from, row for row.

    Attributes:
        sweep: Points at their own times.
        flow: (N, 3) metres to where the same surface is at the same time of the next sweep.
        dynamic: (N,) bool.
        body: (N,) number of the object, 0 for ground.
        ground: (N,) bool.
        pose: (4, 4) world_from_sensor at the stamp.
        straight: Where the points were at the stamp, (N, 3) metres, if they do not move.
    """

    sweep: Sweep
    flow: np.ndarray
    dynamic: np.ndarray
    body: np.ndarray
    ground: np.ndarray
    pose: np.ndarray
    straight: np.ndarray


class Turning:
    """A lidar that turns clockwise; its sweeps are cut by time, or where it has gone round.

    Args:
        simulator: The street.
        degrees: Of azimuth in a sweep. Beyond 360 a part of the scene is seen twice.
        first_s: Seconds from the stamp to the first point.
    """

    def __init__(self, simulator: SweepSimulator, degrees=360.0, first_s=0.0):
        self._simulator = simulator
        self._degrees = degrees
        self._first_s = first_s
        self._interval_s = simulator.interval_s

    def sweep(self, index: int) -> BentSweep:
        """The sweep of a number."""
        snapshot = self._simulator.sweep(index)
        rows, columns = self._seen(snapshot, index)
        times_s = (columns + 0.5) / _COLUMNS * self._interval_s + self._first_s
        now_s = index * self._interval_s
        xyz, _ = self._places(snapshot, rows, columns, now_s, now_s)
        later, straight = self._places(snapshot, rows, columns, now_s, now_s + self._interval_s)
        sweep = Sweep(
            xyz.astype(np.float32),
            snapshot.truth.stamp_ns,
            "lidar",
            times_s=times_s.astype(np.float32),
        )
        return BentSweep(
            sweep,
            (later - xyz).astype(np.float32),
            snapshot.truth.dynamic[rows],
            snapshot.truth.object_id[rows],
            snapshot.truth.ground[rows],
            snapshot.pose,
            straight,
        )

    def _seen(self, snapshot: TrueSweep, index: int):
        """Row and column, of `_COLUMNS`, of each point; those seen twice come twice."""
        turn = self._degrees / 360
        azimuth = np.arctan2(snapshot.xyz[:, 1], snapshot.xyz[:, 0])
        turns = (0.5 - azimuth / (2 * np.pi) - index * turn) % 1.0
        rows = np.arange(len(turns))
        rows, turns = np.concatenate([rows, rows]), np.concatenate([turns, turns + 1])
        inside = turns < turn
        columns = (turns[inside] / turn * _COLUMNS).astype(int)
        return rows[inside], np.minimum(columns, _COLUMNS - 1)

    def _places(self, snapshot, rows, columns, now_s, start_s):
        """Where points of a snapshot at `now_s` are, each at its time after `start_s`.

        Returns (N, 3) in the frame of the sensor then, and (N, 3) in that of the snapshot.
        """
        scene = self._simulator.scene
        shift_s = self._first_s + start_s
        column_s = shift_s + (np.arange(_COLUMNS) + 0.5) / _COLUMNS * self._interval_s
        straight = snapshot.xyz[rows].astype(np.float64)
        world = _applied(snapshot.pose, straight)
        bodies, dynamic = snapshot.truth.object_id[rows], snapshot.truth.dynamic[rows]
        for number in np.unique(bodies[dynamic]):
            body = scene.bodies[number - 1]
            body_from_world = invert(body.world_from_body(now_s))
            own = np.flatnonzero(bodies == number)
            moves = {
                column: body.world_from_body(column_s[column]) @ body_from_world
                for column in np.unique(columns[own])
            }
            matrices = np.array([moves[column] for column in columns[own]])
            world[own] = _applied(matrices, world[own])
        sensors = np.array([invert(scene.ego.world_from_sensor(time_s)) for time_s in column_s])
        return _applied(sensors[columns], world), straight


def _applied(poses, points):
    return np.einsum("...ij,...j->...i", poses[..., :3, :3], points) + poses[..., :3, 3]
