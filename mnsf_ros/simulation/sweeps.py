# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Simulated sweeps with their exact flow."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from mnsf_ros.geometry.transforms import FloatArray, apply, invert
from mnsf_ros.recording.flow_truth import DYNAMIC_SPEED_M_S, SurfaceClass
from mnsf_ros.simulation.lidar import MIN_RANGE_M, Rays, ShapeTable
from mnsf_ros.simulation.scene import build_scene
from mnsf_ros.simulation.street import ground_hits, intensities

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from mnsf_ros.simulation.scenarios import Stage
    from mnsf_ros.simulation.settings import SimulationSettings

# 2024-05-23T08:00:00Z: fixed, so that equal settings give equal recordings.
FIRST_STAMP_NS = 1_716_451_200_000_000_000
_ALL = (slice(None), slice(None))
# The points of a rolling sweep are measured in so many moments: every 7 degrees.
_NUM_PARTS = 50
_FARTHEST_DROP_M = 8.0
# Share of the rays that a drop returns, for each share of light that is lost per metre.
_DROPS_PER_LOSS = 0.5


@dataclass(frozen=True)
class SimulatedSweep:
    """One sweep of the lidar, with the motion of every point.

    N is the number of returned points; all coordinates are in the lidar frame of the moment when
    the point was measured (x forward, y left, z up). The flow leads to where the same surface is
    one interval later, in the lidar frame of that moment.

    Attributes:
        xyz: (N, 3) measured points in metres.
        intensity: (N,) from 0 to 255.
        ring: (N,) beam number, 0 is the lowest.
        flow, dynamic, ground, class_id: As in `FlowTruth`.
        body: (N,) number of the body in the scene, -1 for ground and drops of rain.
        valid: (N,) whether the point is on a surface, and no drop of rain.
        stamp_ns: Time of the sweep in nanoseconds.
        world_from_sensor: (4, 4) pose of the lidar at the stamp.
        times_ns: (N,) nanoseconds from the stamp to when each point was measured; None if the
            sweep is taken in an instant.
    """

    xyz: NDArray[np.float32]
    intensity: NDArray[np.float32]
    ring: NDArray[np.uint16]
    flow: NDArray[np.float32]
    dynamic: NDArray[np.bool_]
    ground: NDArray[np.bool_]
    class_id: NDArray[np.uint8]
    body: NDArray[np.int32]
    valid: NDArray[np.bool_]
    stamp_ns: int
    world_from_sensor: FloatArray
    times_ns: NDArray[np.uint32] | None = None


def simulate_sweeps(
    settings: SimulationSettings, stage: Stage | None = None
) -> Iterator[SimulatedSweep]:
    """Yields the sweeps of a recording in the order of their stamps.

    Every sweep has flow, also the last one: its truth leads to the sweep that would follow.

    Args:
        settings: Of the simulation.
        stage: Takes the place of the scenario of the settings.
    """
    simulator = SweepSimulator(settings, stage)
    for index in range(settings.num_sweeps):
        yield simulator.sweep(index)


class SweepSimulator:
    """Takes sweeps of one scene, in any order."""

    def __init__(self, settings: SimulationSettings, stage: Stage | None = None) -> None:
        """Builds the scene, see `build_scene`."""
        self.settings = settings
        self.scene = build_scene(settings, stage)
        bodies = self.scene.bodies
        owners = [number for number, body in enumerate(bodies) for _ in body.model.shapes]
        self._shapes = ShapeTable([s for body in bodies for s in body.model.shapes], owners)
        self._poses = np.array([body.world_from_body(0.0) for body in bodies])
        self._movers = [number for number, body in enumerate(bodies) if body.trip is not None]
        # The last entries are for ground: body number -1.
        self._classes = np.array([int(b.model.surface_class) for b in bodies] + [0], np.uint8)
        self._reflectivity = np.array([b.model.reflectivity for b in bodies] + [0.0])

    def sweep(self, index: int) -> SimulatedSweep:
        """Returns the sweep with the given number, counted from 0."""
        settings = self.settings
        time_s = index * settings.interval_s
        rng = np.random.default_rng([settings.seed, 1, index])
        parts = list(self._parts(index, rng))
        taken = [self._measured(rays, time_s + after_s, rng) for rays, after_s in parts]
        columns = {name: np.concatenate([part[name] for part in taken]) for name in taken[0]}
        times_ns = None
        if self.scene.sensor.is_rolling:
            after_ns = np.array([round(after_s * 1e9) for _, after_s in parts], np.uint32)
            times_ns = np.repeat(after_ns, [len(part["xyz"]) for part in taken])
        return SimulatedSweep(
            **columns,
            stamp_ns=FIRST_STAMP_NS + round(index * 1e9 / settings.rate_hz),
            world_from_sensor=self.scene.ego.world_from_sensor(time_s),
            times_ns=times_ns,
        )

    def _parts(self, index: int, rng: np.random.Generator) -> Iterator[tuple[Rays, float]]:
        """Yields the rays that are sent at a time, and how many seconds after the stamp that is."""
        settings, sensor = self.settings, self.scene.sensor
        # Real lidars do not start each revolution at the same angle: without this a standing
        # vehicle would measure the very same points again and again.
        phase = rng.uniform()
        per_turn, num_beams = settings.num_columns, settings.num_beams
        if not sensor.is_rolling:
            yield Rays.revolution(per_turn, num_beams, phase), 0.0
            return
        num_columns = round(per_turn * sensor.degrees / 360)
        first = index * num_columns
        edges = np.linspace(0, num_columns, _NUM_PARTS + 1).round().astype(int).tolist()
        for begin, end in pairwise(edges):
            # The lidar turns to the right, so the last column of a part is the leftmost of it.
            start = -(first + end) % per_turn * 2 * math.pi / per_turn
            rays = Rays.sector(start, end - begin, per_turn, num_beams, phase)
            yield rays, (begin + end) / 2 / num_columns * settings.interval_s

    def _measured(
        self, rays: Rays, time_s: float, rng: np.random.Generator
    ) -> dict[str, NDArray[Any]]:
        """Returns the arrays of a SimulatedSweep measured at one time, by their names."""
        settings, rain_per_m = self.settings, self.scene.sensor.rain_per_m
        world_from_sensor = self.scene.ego.world_from_sensor(time_s)
        ranges, body, class_id = self._first_hits(rays, time_s, world_from_sensor)
        valid: NDArray[np.bool_] = np.ones(len(ranges), dtype=bool)
        if rain_per_m:
            valid = _add_rain(ranges, rain_per_m, rng)
            body[~valid], class_id[~valid] = -1, 0
        kept = np.flatnonzero(ranges <= settings.max_range_m)
        kept = kept[rng.uniform(size=len(kept)) >= settings.dropout]
        directions = np.stack(rays.directions(np.eye(3), _ALL), axis=-1).reshape(-1, 3)[kept]
        measured = ranges[kept] + rng.normal(0.0, settings.range_noise_m, len(kept))
        xyz = (directions * measured[:, None]).astype(np.float32)
        body, class_id = body[kept], class_id[kept]
        flow, dynamic = self._truth(xyz.astype(np.float64), body, time_s)
        world = apply(world_from_sensor, directions * ranges[kept, None])
        street, reflectivity = self.scene.street, self._reflectivity[body]
        return {
            "xyz": xyz,
            "intensity": intensities(street, world, class_id, reflectivity, rng),
            "ring": (kept % settings.num_beams).astype(np.uint16),
            "flow": flow,
            "dynamic": dynamic,
            "ground": (class_id == SurfaceClass.ROAD) | (class_id == SurfaceClass.SIDEWALK),
            "class_id": class_id,
            "body": body,
            "valid": valid[kept],
        }

    def _first_hits(
        self, rays: Rays, time_s: float, world_from_sensor: FloatArray
    ) -> tuple[FloatArray, NDArray[np.int32], NDArray[np.uint8]]:
        """Returns true range, body number (-1: ground or nothing) and class of every ray, flat."""
        for number in self._movers:
            self._poses[number] = self.scene.bodies[number].world_from_body(time_s)
        max_range_m = self.settings.max_range_m
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
        interval_s = self.settings.interval_s
        now, then = time_s, time_s + interval_s
        ego = self.scene.ego
        world = apply(ego.world_from_sensor(now), points)
        moved = world.copy()
        for number in np.intersect1d(body, self._movers):
            mover = self.scene.bodies[number]
            then_from_now = mover.world_from_body(then) @ invert(mover.world_from_body(now))
            own = body == number
            moved[own] = apply(then_from_now, world[own])
        flow = apply(invert(ego.world_from_sensor(then)), moved) - points
        speed = np.linalg.norm(moved - world, axis=1) / interval_s
        return flow.astype(np.float32), speed > DYNAMIC_SPEED_M_S


def _add_rain(ranges: FloatArray, loss_per_m: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Removes returns and adds drops near the lidar, in place; returns the mask of surfaces."""
    # There and back again.
    is_lost = rng.uniform(size=len(ranges)) < 1.0 - np.exp(-2.0 * loss_per_m * ranges)
    ranges[is_lost] = np.inf
    drops_m = rng.uniform(MIN_RANGE_M, _FARTHEST_DROP_M, len(ranges))
    is_drop = (rng.uniform(size=len(ranges)) < _DROPS_PER_LOSS * loss_per_m) & (drops_m < ranges)
    ranges[is_drop] = drops_m[is_drop]
    return ~is_drop
