# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Simulated sweeps with their exact flow, and recordings of them."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.transforms import FloatArray, apply, invert
from mnsf_ros.recording.bag_topics import LIDAR_FRAME
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.flow_truth import DYNAMIC_SPEED_M_S, FlowTruth, SurfaceClass, TrueSweep
from mnsf_ros.simulation.lidar import Rays, ShapeTable
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.street import ground_hits, intensities
from mnsf_ros.simulation.worlds import build_scene

# 2024-05-23T08:00:00Z: fixed, so that equal settings give equal recordings.
FIRST_STAMP_NS = 1_716_451_200_000_000_000
_ALL = (slice(None), slice(None))


class SweepSimulator:
    """Takes sweeps of one scene, in any order.

    Each point is in the lidar frame of the moment when it was measured (x forward, y left, z up).
    The flow leads to where the same surface is one interval later, in the lidar frame of that
    moment. Numbers of objects are those of the bodies in the scene, counted from 1; ground and
    drops of rain are no object, and drops have no valid flow. Columns are `intensity` (0 to 255),
    `ring` (0 is the lowest beam), and where each point has its own time `t`, nanoseconds from the
    stamp.

    Attributes:
        scene: The scene.
        interval_s: Seconds from one sweep to the next.
        num_sweeps: Number of sweeps of the recording, at least one.
    """

    def __init__(self, settings: SimulationSettings) -> None:
        """Builds the scene of the settings."""
        self.scene = build_scene(settings)
        self.interval_s = 1.0 / self.scene.sensor.rate_hz
        self.num_sweeps = max(1, round(settings.duration_s * self.scene.sensor.rate_hz))
        self._seed = settings.seed
        bodies = self.scene.bodies
        owners = [number for number, body in enumerate(bodies) for _ in body.model.shapes]
        self._shapes = ShapeTable([s for body in bodies for s in body.model.shapes], owners)
        self._poses = np.array([body.world_from_body(0.0) for body in bodies]).reshape(-1, 4, 4)
        self._movers = [number for number, body in enumerate(bodies) if body.trip is not None]
        # The last entries are for ground: body number -1.
        self._classes = np.array([int(b.model.surface_class) for b in bodies] + [0], np.uint8)
        self._reflectivity = np.array([b.model.reflectivity for b in bodies] + [0.0])

    def __iter__(self) -> Iterator[TrueSweep]:
        """Yields the sweeps of the recording in the order of their stamps."""
        return map(self.sweep, range(self.num_sweeps))

    def sweep(self, index: int) -> TrueSweep:
        """Returns the sweep with the given number, counted from 0.

        The truth of the last one leads to the sweep that would follow.
        """
        sensor, time_s = self.scene.sensor, index * self.interval_s
        rng = np.random.default_rng([self._seed, 1, index])
        # Without a phase a standing vehicle would measure the very same points again and again.
        moments = list(sensor.rays(index, rng.uniform()))
        taken = [self._measured(rays, time_s + after_s, rng) for rays, after_s in moments]
        arrays = {name: np.concatenate([part[name] for part in taken]) for name in taken[0]}
        xyz = arrays.pop("xyz")
        columns = {name: arrays.pop(name) for name in ("intensity", "ring")}
        if sensor.is_rolling:
            after_ns = np.array([round(after_s * 1e9) for _, after_s in moments], np.uint32)
            columns["t"] = np.repeat(after_ns, [len(part["xyz"]) for part in taken])
        truth = FlowTruth(FIRST_STAMP_NS + round(index * 1e9 / sensor.rate_hz), **arrays)
        return TrueSweep(xyz, truth, columns, self.scene.ego.world_from_sensor(time_s))

    def _measured(
        self, rays: Rays, time_s: float, rng: np.random.Generator
    ) -> dict[str, NDArray[Any]]:
        """Returns what is measured at one time, with its truth, by the names of the arrays."""
        sensor = self.scene.sensor
        world_from_sensor = self.scene.ego.world_from_sensor(time_s)
        ranges, body, class_id = self._first_hits(rays, time_s, world_from_sensor)
        valid: NDArray[np.bool_] = np.ones(len(ranges), dtype=bool)
        if sensor.rain_per_m:
            valid = sensor.add_rain(ranges, rng)
            body[~valid], class_id[~valid] = -1, 0
        kept = np.flatnonzero(ranges <= sensor.max_range_m)
        kept = kept[rng.uniform(size=len(kept)) >= sensor.dropout]
        directions = np.stack(rays.directions(np.eye(3), _ALL), axis=-1).reshape(-1, 3)[kept]
        measured = ranges[kept] + rng.normal(0.0, sensor.range_noise_m, len(kept))
        xyz = (directions * measured[:, None]).astype(np.float32)
        body, class_id = body[kept], class_id[kept]
        flow, dynamic = self._truth(xyz.astype(np.float64), body, time_s)
        return {
            "xyz": xyz,
            "intensity": intensities(class_id, self._reflectivity[body], rng),
            "ring": (kept % rays.shape[1]).astype(np.uint16),
            "flow": flow,
            "valid": valid[kept],
            "dynamic": dynamic,
            "ground": (class_id == SurfaceClass.ROAD) | (class_id == SurfaceClass.SIDEWALK),
            "class_id": class_id,
            "object_id": (body + 1).astype(np.uint32),
        }

    def _first_hits(
        self, rays: Rays, time_s: float, world_from_sensor: FloatArray
    ) -> tuple[FloatArray, NDArray[np.int32], NDArray[np.uint8]]:
        """Returns true range, body number (-1: ground or nothing) and class of every ray, flat."""
        for number in self._movers:
            self._poses[number] = self.scene.bodies[number].world_from_body(time_s)
        max_range_m = self.scene.sensor.max_range_m
        lidar_from_body = invert(world_from_sensor) @ self._poses
        block_ranges, block_body = self._shapes.cast(rays, lidar_from_body, max_range_m)
        ranges, body = block_ranges.ravel(), block_body.ravel()
        directions = np.stack(rays.directions(world_from_sensor[:3, :3], _ALL), axis=-1)
        ground, ground_class = ground_hits(
            self.scene.street, world_from_sensor[:3, 3], directions.reshape(-1, 3), max_range_m
        )
        on_ground = ground < ranges
        body[on_ground] = -1
        class_id = np.where(on_ground, ground_class, self._classes[body])
        return np.minimum(ranges, ground), body, class_id

    def _truth(
        self, points: FloatArray, body: NDArray[np.int32], time_s: float
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Returns (N, 3) flow and (N,) dynamic of points in the lidar frame at a time."""
        now, then = time_s, time_s + self.interval_s
        ego = self.scene.ego
        world = apply(ego.world_from_sensor(now), points)
        moved = world.copy()
        for number in np.intersect1d(body, self._movers):
            mover = self.scene.bodies[number]
            then_from_now = mover.world_from_body(then) @ invert(mover.world_from_body(now))
            own = body == number
            moved[own] = apply(then_from_now, world[own])
        flow = apply(invert(ego.world_from_sensor(then)), moved) - points
        speed = np.linalg.norm(moved - world, axis=1) / self.interval_s
        return flow.astype(np.float32), speed > DYNAMIC_SPEED_M_S


def write_recording(
    settings: SimulationSettings,
    path: Path | str,
    progress: Callable[[int, int], None] | None = None,
    *,
    overwrite: bool = False,
) -> SweepSimulator:
    """Simulates a recording, writes it with a BagWriter and returns its simulator.

    After every sweep `progress` is called with the number of sweeps done and to do.

    Raises:
        RecordingError: The recording cannot be written.
    """
    simulator = SweepSimulator(settings)
    with BagWriter(path, overwrite=overwrite) as writer:
        for number, sweep in enumerate(simulator, start=1):
            # The last sweep has no next sweep in which its points could be found.
            valid = sweep.truth.valid & (number < simulator.num_sweeps)
            true = replace(sweep, truth=replace(sweep.truth, valid=valid))
            writer.write_sweep(true, LIDAR_FRAME)
            if progress is not None:
                progress(number, simulator.num_sweeps)
    return simulator
