# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Simulated sweeps with their exact flow."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import AnyFloats, Bools, Floats, Floats32, Ints32
from mnsf_ros.geometry.transforms import apply, invert
from mnsf_ros.recording.flow_truth import DYNAMIC_SPEED_M_S, FlowTruth, SurfaceClass, TrueSweep
from mnsf_ros.simulation.imu import turn_rates
from mnsf_ros.simulation.lidar import Rays, ShapeTable
from mnsf_ros.simulation.returns import SMOOTHNESS, are_returned, reflectance
from mnsf_ros.simulation.scene import Scene
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.street import brightness, ground_cosines, ground_hits, intensities
from mnsf_ros.simulation.worlds import build_scene

# 2024-05-23T08:00:00Z: fixed, so that equal settings give equal recordings.
FIRST_STAMP_NS = 1_716_451_200_000_000_000
# The IMU starts this long before the first sweep, and ends this long after the last one.
_IMU_LEAD_S = 0.2
_ALL = (slice(None), slice(None))
# Sweeps that can be taken beyond the end of the recording, as far as none are missing.
_FURTHER_TURNS = 100


class SweepSimulator:
    """Takes sweeps of one scene, in any order.

    Each point is in the lidar frame of the moment when it was measured (x forward, y left, z up).
    The flow leads to the place of the same surface at the next sweep, in the lidar frame of that
    moment. Objects have the numbers of the bodies in the scene, counted from 1; 0 for ground and
    drops of rain. Drops and the own body have no valid flow. Columns are `intensity` (0 to 255),
    `ring` (0 is the lowest beam), and of a rolling lidar `t`, nanoseconds from the stamp.

    Attributes:
        scene: The scene.
        interval_s: Seconds from one sweep to the next, without jitter and gaps.
        times_s: (T,) seconds of the sweeps of the recording, and of further ones.
        num_sweeps: Number of sweeps of the recording, at least one.
    """

    def __init__(self, settings: SimulationSettings, scene: Scene | None = None) -> None:
        """Prepares the scene of the settings, or another one."""
        self.scene = build_scene(settings) if scene is None else scene
        self.interval_s = 1.0 / self.scene.sensor.rate_hz
        num_turns = max(1, round(settings.duration_s * self.scene.sensor.rate_hz))
        self._turns, self.times_s = self.scene.sensor.sweep_times(
            num_turns + _FURTHER_TURNS, np.random.default_rng([settings.seed, 2])
        )
        self.num_sweeps = max(1, int(np.searchsorted(self._turns, num_turns)))
        self._seed = settings.seed
        bodies = self.scene.bodies
        owners = [number for number, body in enumerate(bodies) for _ in body.model.shapes]
        self._shapes = ShapeTable([s for body in bodies for s in body.model.shapes], owners)
        # The last entry is for ground: number -1.
        self._body_of_shape = np.array([*owners, -1], dtype=np.int32)
        self._poses = np.array([body.world_from_body(0.0) for body in bodies]).reshape(-1, 4, 4)
        self._movers = [
            number for number, b in enumerate(bodies) if not isinstance(b.placement, np.ndarray)
        ]
        # The last entries are for ground: body number -1.
        self._classes = np.array([int(b.model.surface_class) for b in bodies] + [0], np.uint8)
        self._reflectivity = np.array([b.model.reflectivity for b in bodies] + [0.0])
        self._smoothness = np.array([b.model.smoothness for b in bodies] + [0.0])

    def __iter__(self) -> Iterator[TrueSweep]:
        """Yields the sweeps of the recording in the order of their stamps."""
        return map(self.sweep, range(self.num_sweeps))

    def sweep(self, index: int) -> TrueSweep:
        """Returns the sweep with the given number, counted from 0.

        The truth of the last one leads to the sweep that would follow.
        """
        sensor, turn = self.scene.sensor, int(self._turns[index])
        time_s, next_s = self.times_s[index : index + 2].tolist()
        rng = np.random.default_rng([self._seed, 1, turn])
        # Without a phase a standing vehicle measures the same points in each sweep.
        moments = list(sensor.rays(turn, rng.uniform()))
        taken = [
            self._measured(rays, time_s + after_s, next_s + after_s, rng)
            for rays, after_s in moments
        ]
        arrays = {name: np.concatenate([part[name] for part in taken]) for name in taken[0]}
        xyz = arrays.pop("xyz")
        columns = {name: arrays.pop(name) for name in ("intensity", "ring")}
        if sensor.is_rolling:
            after_ns = np.array([round(after_s * 1e9) for _, after_s in moments], np.uint32)
            columns["t"] = np.repeat(after_ns, [len(part["xyz"]) for part in taken])
        truth = FlowTruth(FIRST_STAMP_NS + round(time_s * 1e9), **arrays)
        return TrueSweep(xyz, truth, columns, self.scene.ego.world_from_sensor(time_s))

    def turn_rates(self, rate_hz: float) -> Floats:
        """Returns the turn rates of an IMU on the lidar, from before the first sweep: (T, 4).

        Columns are seconds as in `times_s`, then rad/s about x, y and z of the lidar. At 0 Hz there
        are none.
        """
        end_s = self.times_s[self.num_sweeps - 1] + self.interval_s
        number = round((end_s + 2 * _IMU_LEAD_S) * rate_hz)
        times_s = np.arange(number) / max(rate_hz, 1.0) - _IMU_LEAD_S
        rng = np.random.default_rng([self._seed, 6])
        return np.column_stack([times_s, turn_rates(self.scene.ego, times_s, rate_hz, rng)])

    def _measured(
        self, rays: Rays, time_s: float, next_s: float, rng: np.random.Generator
    ) -> dict[str, NDArray[Any]]:
        """Returns the points measured at one time, their columns and truth, by name."""
        sensor = self.scene.sensor
        world_from_sensor = self.scene.ego.world_from_sensor(time_s)
        ranges, shape, class_id = self._first_hits(rays, time_s, world_from_sensor)
        body = self._body_of_shape[shape]
        if math.isfinite(sensor.reach_m):
            self._remove_lost(rays, world_from_sensor, ranges, shape, class_id, rng)
        valid: Bools = np.ones(len(ranges), dtype=bool)
        if sensor.rain_per_m:
            valid = sensor.add_rain(ranges, rng)
            body[~valid], class_id[~valid] = -1, 0
        valid &= class_id != SurfaceClass.OWN_BODY
        kept = np.flatnonzero(ranges <= sensor.max_range_m)
        kept = kept[rng.uniform(size=len(kept)) >= sensor.dropout]
        directions = np.stack(rays.directions(np.eye(3), _ALL), axis=-1).reshape(-1, 3)[kept]
        measured = ranges[kept] + rng.normal(0.0, sensor.range_noise_m, len(kept))
        xyz = (directions * measured[:, None]).astype(np.float32)
        body, class_id = body[kept], class_id[kept]
        flow, dynamic = self._truth(xyz.astype(np.float64), body, time_s, next_s)
        return {
            "xyz": xyz,
            "intensity": intensities(brightness(class_id, self._reflectivity[body]), rng),
            "ring": (kept % rays.shape[1]).astype(np.uint16),
            "flow": flow,
            "valid": valid[kept],
            "dynamic": dynamic & (class_id != SurfaceClass.OWN_BODY),
            "ground": (class_id == SurfaceClass.ROAD) | (class_id == SurfaceClass.SIDEWALK),
            "class_id": class_id,
            "object_id": (body + 1).astype(np.uint32),
        }

    def _first_hits(
        self, rays: Rays, time_s: float, world_from_sensor: AnyFloats
    ) -> tuple[AnyFloats, Ints32, NDArray[np.uint8]]:
        """Returns true range, shape number (-1: ground or nothing) and class of every ray, flat."""
        for number in self._movers:
            self._poses[number] = self.scene.bodies[number].world_from_body(time_s)
        sensor = self.scene.sensor
        lidar_from_body = invert(world_from_sensor) @ self._poses
        limits_m = (sensor.min_range_m, sensor.max_range_m)
        block_ranges, block_shape = self._shapes.cast(rays, lidar_from_body, limits_m)
        ranges, shape = block_ranges.ravel(), block_shape.ravel()
        directions = np.stack(rays.directions(world_from_sensor[:3, :3], _ALL), axis=-1)
        ground, ground_class = ground_hits(
            self.scene.street,
            world_from_sensor[:3, 3],
            directions.reshape(-1, 3),
            limits_m[1],
        )
        on_ground = ground < ranges
        shape[on_ground] = -1
        class_id = np.where(on_ground, ground_class, self._classes[self._body_of_shape[shape]])
        return np.minimum(ranges, ground), shape, class_id

    def _remove_lost(
        self,
        rays: Rays,
        world_from_sensor: AnyFloats,
        ranges: AnyFloats,
        shape: Ints32,
        class_id: NDArray[np.uint8],
        rng: np.random.Generator,
    ) -> None:
        """Removes the returns that the lidar does not receive, in place."""
        met = np.flatnonzero(np.isfinite(ranges))
        directions = np.stack(rays.directions(np.eye(3), _ALL), axis=-1).reshape(-1, 3)[met]
        points, body = directions * ranges[met, None], self._body_of_shape[shape[met]]
        ahead = directions @ world_from_sensor[:3, :3].T
        cosines = ground_cosines(self.scene.street, apply(world_from_sensor, points), ahead)
        shape = shape[met]
        on_shape, lidar_from_body = shape >= 0, invert(world_from_sensor) @ self._poses
        normals = self._shapes.normals(shape[on_shape], points[on_shape], lidar_from_body)
        cosines[on_shape] = np.abs((normals * directions[on_shape]).sum(axis=1))
        mean = brightness(class_id[met], self._reflectivity[body])
        smoothness = np.maximum(SMOOTHNESS[class_id[met]], self._smoothness[body])
        shares = reflectance(mean, smoothness, self.scene.wetness, cosines)
        sensor = self.scene.sensor
        seen = are_returned(shares, ranges[met], sensor.reach_m, sensor.fog_per_m, rng)
        ranges[met[~seen]] = np.inf

    def _truth(
        self, points: AnyFloats, body: Ints32, now: float, then: float
    ) -> tuple[Floats32, Bools]:
        """Returns (N, 3) flow, and (N,) dynamic, of points in the lidar frame between two times."""
        ego = self.scene.ego
        world = apply(ego.world_from_sensor(now), points)
        moved = world.copy()
        for number in np.intersect1d(body, self._movers):
            mover = self.scene.bodies[number]
            then_from_now = mover.world_from_body(then) @ invert(mover.world_from_body(now))
            own = body == number
            moved[own] = apply(then_from_now, world[own])
        flow = apply(invert(ego.world_from_sensor(then)), moved) - points
        speed = np.linalg.norm(moved - world, axis=1) / (then - now)
        return flow.astype(np.float32), speed > DYNAMIC_SPEED_M_S
