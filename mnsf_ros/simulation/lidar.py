# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A spinning lidar: its rays, and the first hit of each."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.simulation.bodies import Directions, Shape, entry_ranges

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mnsf_ros.geometry.transforms import FloatArray

_TOP_DEG, _KNEE_DEG, _BOTTOM_DEG = 2.0, -8.33, -24.8
MIN_RANGE_M = 0.9
# Glass returns rays within 15 degrees of its normal.
_GLASS_COSINE = 0.966


@dataclass(frozen=True)
class Rays:
    """The rays of a revolution or a part of one in the lidar frame: C azimuth columns of B beams.

    Columns run from `start` (radians) to the left, so many `per_turn`. Elevations (B,) are in
    radians, increasing: beam 0 points lowest.
    """

    cos_azimuth: FloatArray
    sin_azimuth: FloatArray
    elevations: FloatArray
    start: float
    per_turn: int

    @classmethod
    def sector(
        cls, start: float, num_columns: int, per_turn: int, num_beams: int, phase: float
    ) -> Rays:
        """Returns evenly spaced columns, the first `phase` (0 to 1) of a step behind the start.

        As in a common 64-beam sensor the upper half of the beams is packed more densely.
        """
        half = num_beams // 2
        step = (_KNEE_DEG - _BOTTOM_DEG) / half
        lower = np.linspace(_BOTTOM_DEG, _KNEE_DEG - step, half)
        upper = np.linspace(_KNEE_DEG, _TOP_DEG, num_beams - half)
        azimuth = start + (np.arange(num_columns) + phase) * (2 * math.pi / per_turn)
        elevations = np.radians(np.concatenate([lower, upper]))
        return cls(np.cos(azimuth), np.sin(azimuth), elevations, start, per_turn)

    @classmethod
    def revolution(cls, num_columns: int, num_beams: int, phase: float) -> Rays:
        """Returns the columns of a whole turn that begins at -pi."""
        return cls.sector(-math.pi, num_columns, num_columns, num_beams, phase)

    def directions(self, frame_from_lidar: FloatArray, window: Window) -> Directions:
        """Returns x, y and z of the directions of a window's rays, rotated (3, 3) to a frame."""
        columns, beams = window
        cos_azimuth, sin_azimuth = self.cos_azimuth[columns, None], self.sin_azimuth[columns, None]
        elevations = self.elevations[beams]
        cos_elevation, sin_elevation = np.cos(elevations), np.sin(elevations)
        x, y, z = (
            (row[0] * cos_azimuth + row[1] * sin_azimuth) * cos_elevation + row[2] * sin_elevation
            for row in frame_from_lidar
        )
        return x, y, z


Window = tuple[slice, slice]


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
        self, rays: Rays, lidar_from_body: FloatArray, max_range_m: float
    ) -> tuple[FloatArray, NDArray[np.int32]]:
        """Returns (C, B) ranges to the first shape of each ray and (C, B) body numbers.

        They are `inf` metres and -1 where nothing is met. Shapes entirely beyond `max_range_m` are
        skipped. `lidar_from_body` is (bodies, 4, 4).
        """
        num_columns, num_beams = len(rays.cos_azimuth), len(rays.elevations)
        ranges = np.full((num_columns, num_beams), np.inf)
        bodies = np.full((num_columns, num_beams), -1, dtype=np.int32)
        poses = lidar_from_body[self.body_of_shape] @ self._poses
        nearest = self._nearest(poses)
        order = np.argsort(nearest, kind="stable")
        seen = (nearest < max_range_m) & self._may_be_in(rays, poses)
        for k in order[seen[order]]:
            for window in _windows(poses[k], self.half_extents[k], rays, float(nearest[k])):
                block = ranges[window]
                # Shapes come nearest first, so most of what is far is already hidden.
                if block.size == 0 or block.max() <= nearest[k]:
                    continue
                entry = self._entry(int(k), poses[k], rays, window)
                nearer = (entry < block) & (entry >= MIN_RANGE_M)
                np.copyto(block, entry, where=nearer)
                np.copyto(bodies[window], self.body_of_shape[k], where=nearer)
        return ranges, bodies

    def _nearest(self, poses: FloatArray) -> FloatArray:
        """Returns (K,) distances from the lidar to the nearest point of each bounding box."""
        local = np.einsum("kji,kj->ki", poses[:, :3, :3], -poses[:, :3, 3])
        outside = np.maximum(np.abs(local) - self.half_extents, 0.0)
        nearest: FloatArray = np.linalg.norm(outside, axis=1)
        return nearest

    def _may_be_in(self, rays: Rays, poses: FloatArray) -> NDArray[np.bool_]:
        """Returns a (K,) mask of the shapes whose bounding sphere some column can meet."""
        half = math.pi * len(rays.cos_azimuth) / rays.per_turn
        x, y = poses[:, 0, 3], poses[:, 1, 3]
        apart = np.arctan2(y, x) - (rays.start + half)
        apart = np.abs((apart + math.pi) % (2 * math.pi) - math.pi)
        reach = np.arcsin(np.minimum(self._radii / np.maximum(np.hypot(x, y), 1e-9), 1.0))
        is_around = np.hypot(x, y) <= self._radii
        return np.asarray(is_around | (apart <= half + reach + 2 * math.pi * 2 / rays.per_turn))

    def _entry(self, k: int, pose: FloatArray, rays: Rays, window: Window) -> FloatArray:
        """Returns the ranges at which the window's rays enter shape k, metres; `inf`: misses."""
        shape_from_lidar = pose[:3, :3].T
        origin = shape_from_lidar @ -pose[:3, 3]
        directions = rays.directions(shape_from_lidar, window)
        entry = entry_ranges(self._kinds[k], self.half_extents[k], origin, directions)
        if self._are_glass[k]:
            return np.where(np.abs(directions[1]) >= _GLASS_COSINE, entry, np.inf)
        return entry


_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


def _windows(pose: FloatArray, half: FloatArray, rays: Rays, nearest_m: float) -> list[Window]:
    """Returns the columns and beams that can meet a bounding box; two windows across the start."""
    corners = (_CORNERS * half) @ pose[:3, :3].T + pose[:3, 3]
    beams = _beams(corners, rays, nearest_m)
    center = math.atan2(pose[1, 3], pose[0, 3])
    azimuth = np.arctan2(corners[:, 1], corners[:, 0]) - center
    azimuth = (azimuth + math.pi) % (2 * math.pi) - math.pi
    low, high = float(azimuth.min()), float(azimuth.max())
    num_columns = len(rays.cos_azimuth)
    per_radian = rays.per_turn / (2 * math.pi)
    first = math.floor((center + low - rays.start) * per_radian) - 1
    last = math.ceil((center + high - rays.start) * per_radian) + 1
    # From above or inside a box its corners surround the lidar: no interval covers it.
    if high - low >= math.pi - 0.1 or last - first >= rays.per_turn:
        return [(slice(0, num_columns), beams)]
    turns = first // rays.per_turn * rays.per_turn
    parts = [(first - turns, last - turns), (0, last - turns - rays.per_turn)]
    columns = [slice(begin, min(end, num_columns)) for begin, end in parts]
    return [(part, beams) for part in columns if part.start < part.stop]


def _beams(corners: FloatArray, rays: Rays, nearest_m: float) -> slice:
    """Returns the beams between the lowest and the highest possible sight of a bounding box."""
    bottom, top = float(corners[:, 2].min()), float(corners[:, 2].max())
    farthest = float(np.hypot(corners[:, 0], corners[:, 1]).max())
    # The nearest point may lie below or above: its horizontal distance can be shorter still.
    near_bottom = math.sqrt(max(nearest_m**2 - bottom**2, 1e-4))
    near_top = math.sqrt(max(nearest_m**2 - top**2, 1e-4))
    lowest = math.atan2(bottom, near_bottom if bottom < 0 else farthest)
    highest = math.atan2(top, near_top if top > 0 else farthest)
    first = int(np.searchsorted(rays.elevations, lowest - 1e-9))
    return slice(first, int(np.searchsorted(rays.elevations, highest + 1e-9)))
