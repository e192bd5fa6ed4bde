# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rays of a lidar, and the first hit of each."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import AnyFloats, Ints32
from mnsf_ros.simulation.bodies import Directions, Shape, entry_ranges, normals

# Glass returns rays within 15 degrees of its normal.
_GLASS_COSINE = 0.966
# Of angles, radians: more than their rounding errors.
_TINY = 1e-9


@dataclass(frozen=True)
class Rays:
    """Rays in the lidar frame: C azimuth columns of B beams, angles in radians."""

    azimuth: AnyFloats  # (C,) increasing, also beyond pi
    elevations: AnyFloats  # (1, B) increasing, the same in all columns, or (C, 1)

    @cached_property
    def _ahead(self) -> tuple[AnyFloats, AnyFloats]:
        return np.cos(self.azimuth), np.sin(self.azimuth)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of columns and of beams."""
        return len(self.azimuth), self.elevations.shape[1]

    def directions(self, frame_from_lidar: AnyFloats, window: "Window") -> Directions:
        """Returns x, y and z of the directions of a window's rays, rotated (3, 3) to a frame."""
        columns, beams = window
        cos_azimuth, sin_azimuth = (part[columns, None] for part in self._ahead)
        elevations = self.elevations[columns if len(self.elevations) > 1 else slice(1), beams]
        cos_elevation, sin_elevation = np.cos(elevations), np.sin(elevations)
        x, y, z = (
            (row[0] * cos_azimuth + row[1] * sin_azimuth) * cos_elevation + row[2] * sin_elevation
            for row in frame_from_lidar
        )
        return x, y, z


# Columns and beams.
Window = tuple[NDArray[np.intp] | slice, slice]


class ShapeTable:
    """All K shapes of a scene, with the number of the body of each, ready to be cast together."""

    def __init__(self, shapes: list[Shape], body_of_shape: list[int]) -> None:
        """Stacks the shapes; `body_of_shape` has one entry per shape."""
        self.half_extents = np.array([shape.half_extents for shape in shapes]).reshape(-1, 3)
        self.body_of_shape = np.array(body_of_shape, dtype=np.int32)
        self._kinds = [shape.kind for shape in shapes]
        self._are_glass = [shape.is_glass for shape in shapes]
        self._radii = np.linalg.norm(self.half_extents, axis=1)
        self._poses = np.array([shape.body_from_shape for shape in shapes]).reshape(-1, 4, 4)

    def cast(
        self, rays: Rays, lidar_from_body: AnyFloats, limits_m: tuple[float, float]
    ) -> tuple[AnyFloats, Ints32]:
        """Returns (C, B) ranges to the first shape of each ray and (C, B) numbers of the shapes.

        They are `inf` metres and -1 without a hit. Rays pass through shapes nearer than the first
        limit; shapes entirely beyond the second are skipped. `lidar_from_body` is (bodies, 4, 4).
        """
        min_range_m, max_range_m = limits_m
        ranges = np.full(rays.shape, np.inf)
        shapes = np.full(rays.shape, -1, dtype=np.int32)
        poses = lidar_from_body[self.body_of_shape] @ self._poses
        nearest = self._nearest(poses)
        order = np.argsort(nearest, kind="stable")
        middles, reaches = self._azimuths(poses)
        first, last = rays.azimuth[[0, -1]]
        apart = np.abs(_turned(middles - (first + last) / 2))
        seen = (nearest < max_range_m) & (apart <= (last - first) / 2 + reaches + _TINY)
        for k in order[seen[order]]:
            off = np.abs(_turned(rays.azimuth - middles[k]))
            columns = np.flatnonzero(off <= reaches[k] + _TINY)
            window = (columns, self._beams(int(k), poses[k], rays))
            block = ranges[window]
            # Shapes come nearest first, so most far ones are hidden already.
            if block.size == 0 or block.max() <= nearest[k]:
                continue
            entry = self._entry(int(k), poses[k], rays, window)
            nearer = (entry < block) & (entry >= min_range_m)
            ranges[window] = np.where(nearer, entry, block)
            shapes[window] = np.where(nearer, k, shapes[window])
        return ranges, shapes

    def normals(self, shapes: Ints32, points: AnyFloats, lidar_from_body: AnyFloats) -> AnyFloats:
        """Returns (N, 3) outward normals at points (N, 3) on shapes (N,), in the lidar frame."""
        poses = (lidar_from_body[self.body_of_shape] @ self._poses)[shapes]
        rotations = poses[:, :3, :3]
        local = np.einsum("nji,nj->ni", rotations, points - poses[:, :3, 3])
        kinds = np.array(self._kinds)[shapes]
        own = normals(kinds, self.half_extents[shapes], local)
        return np.einsum("nij,nj->ni", rotations, own)

    def _nearest(self, poses: AnyFloats) -> AnyFloats:
        """Returns (K,) distances from the lidar to the nearest point of each bounding box."""
        local = np.einsum("kji,kj->ki", poses[:, :3, :3], -poses[:, :3, 3])
        outside = np.maximum(np.abs(local) - self.half_extents, 0.0)
        return np.linalg.norm(outside, axis=1)

    def _azimuths(self, poses: AnyFloats) -> tuple[AnyFloats, AnyFloats]:
        """Returns (K,) azimuths of the shapes, and how far their bounding spheres reach around."""
        x, y = poses[:, 0, 3], poses[:, 1, 3]
        flat_m = np.hypot(x, y)
        reaches = np.arcsin(np.minimum(self._radii / np.maximum(flat_m, _TINY), 1.0))
        return np.arctan2(y, x), np.where(flat_m <= self._radii, math.pi, reaches)

    def _beams(self, k: int, pose: AnyFloats, rays: Rays) -> slice:
        """Returns the beams that can meet the bounding sphere of shape k."""
        distance_m, radius_m = float(np.linalg.norm(pose[:3, 3])), float(self._radii[k])
        if len(rays.elevations) > 1 or distance_m <= radius_m:
            return slice(0, rays.elevations.shape[1])
        middle, reach = math.asin(pose[2, 3] / distance_m), math.asin(radius_m / distance_m) + _TINY
        return slice(
            *np.searchsorted(rays.elevations[0], [middle - reach, middle + reach]).tolist()
        )

    def _entry(self, k: int, pose: AnyFloats, rays: Rays, window: Window) -> AnyFloats:
        """Returns the ranges at which the window's rays enter shape k, metres; `inf`: misses."""
        shape_from_lidar = pose[:3, :3].T
        origin = shape_from_lidar @ -pose[:3, 3]
        directions = rays.directions(shape_from_lidar, window)
        entry = entry_ranges(self._kinds[k], self.half_extents[k], origin, directions)
        if self._are_glass[k]:
            return np.where(np.abs(directions[1]) >= _GLASS_COSINE, entry, np.inf)
        return entry


def _turned(angles: AnyFloats) -> AnyFloats:
    """Returns angles turned to -pi to pi."""
    return (angles + math.pi) % (2 * math.pi) - math.pi
