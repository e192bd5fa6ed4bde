# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rigid things of the scene: solid shapes, their intersections with rays, and their poses.

A shape sits at the origin of its own frame. Rays are given in that frame as one common origin
and three arrays of direction components; ranges are in units of the length of the direction, `inf`
where the ray misses. A ray that starts inside a shape does not see it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import AnyFloats
from mnsf_ros.geometry.transforms import planar_pose
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation.routes import SensorTrip, Trip

Directions: TypeAlias = tuple[AnyFloats, AnyFloats, AnyFloats]

# Stands for zero in divisions: a ray parallel to a face meets it immeasurably far away.
_PARALLEL = 1e-200
# More than the rounding errors of points on a face.
_ON_FACE_M = 1e-6


class ShapeKind(IntEnum):
    """The kinds of solids that can be cast."""

    BOX = 0
    CYLINDER = 1
    SPHERE = 2


@dataclass(frozen=True)
class Shape:
    """One solid of a body, with half sizes in metres along its own x, y and z.

    A cylinder stands along z with radius `half_extents[0]`; a sphere has radius `half_extents[0]`.
    Glass returns only rays that meet it squarely, along its own y; others go through.
    """

    kind: ShapeKind
    half_extents: tuple[float, float, float]
    body_from_shape: AnyFloats
    is_glass: bool = False


def box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Shape:
    """Returns a box that spans the three intervals (metres)."""
    center = [(low + high) / 2 for low, high in (x, y, z)]
    half = ((x[1] - x[0]) / 2, (y[1] - y[0]) / 2, (z[1] - z[0]) / 2)
    return Shape(ShapeKind.BOX, half, planar_pose(center[0], center[1], 0.0, center[2]))


def cylinder(x: float, y: float, radius: float, z: tuple[float, float]) -> Shape:
    """Returns an upright cylinder around (x, y) from height `z[0]` to `z[1]` (metres)."""
    half = (radius, radius, (z[1] - z[0]) / 2)
    return Shape(ShapeKind.CYLINDER, half, planar_pose(x, y, 0.0, (z[0] + z[1]) / 2))


def sphere(x: float, y: float, z: float, radius: float) -> Shape:
    """Returns a sphere around (x, y, z) (metres)."""
    return Shape(ShapeKind.SPHERE, (radius, radius, radius), planar_pose(x, y, 0.0, z))


def entry_ranges(
    kind: ShapeKind, half_extents: AnyFloats, origin: AnyFloats, directions: Directions
) -> AnyFloats:
    """Returns the range at which each ray enters the shape, `inf` if it never does."""
    # Rays beside something round have no entry: the root is NaN, which compares as a miss.
    with np.errstate(invalid="ignore"):
        if kind == ShapeKind.SPHERE:
            near, far = _round_interval(half_extents[0], origin, directions)
        elif kind == ShapeKind.CYLINDER:
            near, far = _round_interval(half_extents[0], origin[:2], directions[:2])
            near, far = _clip(near, far, half_extents[2], origin[2], directions[2])
        else:
            near, far = _slab(half_extents[0], origin[0], directions[0])
            for axis in (1, 2):
                near, far = _clip(near, far, half_extents[axis], origin[axis], directions[axis])
        return np.where((near <= far) & (near > 0.0), near, np.inf)


def normals(
    kinds: NDArray[np.integer[Any]], half_extents: AnyFloats, points: AnyFloats
) -> AnyFloats:
    """Returns (N, 3) outward normals at points on shapes, each in the frame of its shape.

    Kinds are (N,), half extents (N, 3).
    """
    around = points.copy()
    around[:, 2] *= kinds == ShapeKind.SPHERE
    # A cylinder has a lid, a box six faces: the point is on the one that it is least within.
    beyond = np.abs(points) - half_extents
    on_lid = (kinds == ShapeKind.CYLINDER) & (beyond[:, 2] > -_ON_FACE_M)
    axis = np.where(on_lid, 2, np.argmax(beyond, axis=1))
    face = np.eye(3)[axis] * points
    is_flat = on_lid | (kinds == ShapeKind.BOX)
    outward = np.where(is_flat[:, None], face, around)
    return outward / np.maximum(np.linalg.norm(outward, axis=1), _PARALLEL)[:, None]


def _slab(half: float, start: float, direction: AnyFloats) -> tuple[AnyFloats, AnyFloats]:
    """Returns the ranges at which rays enter and leave the layer -half..half of one axis."""
    inverse = 1.0 / np.where(direction == 0.0, _PARALLEL, direction)
    middle = -start * inverse
    reach = half * np.abs(inverse)
    return middle - reach, middle + reach


def _clip(
    near: AnyFloats, far: AnyFloats, half: float, start: float, direction: AnyFloats
) -> tuple[AnyFloats, AnyFloats]:
    """Narrows the interval [near, far] to the layer between -half and +half of one axis."""
    enter, leave = _slab(half, start, direction)
    return np.maximum(near, enter), np.minimum(far, leave)


def _round_interval(
    radius: float, origin: AnyFloats, directions: tuple[AnyFloats, ...]
) -> tuple[AnyFloats, AnyFloats]:
    """Returns the ranges at which rays enter and leave a circle or sphere; NaN if never."""
    squared = np.maximum(sum(direction * direction for direction in directions), _PARALLEL)
    along = sum(start * direction for start, direction in zip(origin, directions, strict=True))
    outside = float(origin @ origin) - radius * radius
    root = np.sqrt(along * along - squared * outside)
    return (-along - root) / squared, (-along + root) / squared


@dataclass(frozen=True)
class Model:
    """A thing in its own frame: x forward, y left, z up, the origin on the ground."""

    surface_class: SurfaceClass
    shapes: tuple[Shape, ...]
    length_m: float  # along x, which nothing else may enter, centered on the origin
    width_m: float  # the same along y
    reflectivity: float  # mean intensity of its points, 0 to 255; white is 100, mirrors shine more
    smoothness: float = 0.0  # share of the light that it reflects as a mirror does, 0 to 1

    @property
    def box(self) -> tuple[AnyFloats, AnyFloats]:
        """Middle and size, (3,) metres each, of the box around its shapes."""
        poses = np.array([shape.body_from_shape for shape in self.shapes])
        half = np.array([shape.half_extents for shape in self.shapes])
        reach = np.einsum("sij,sj->si", np.abs(poses[:, :3, :3]), half)
        low, high = (poses[:, :3, 3] - reach).min(axis=0), (poses[:, :3, 3] + reach).max(axis=0)
        return (low + high) / 2, high - low


# Draws a specimen.
Maker = Callable[[np.random.Generator], Model]


@dataclass(frozen=True)
class Body:
    """A model at rest at a (4, 4) `world_from_body`, on a trip, or fixed to the lidar."""

    model: Model
    placement: AnyFloats | Trip | SensorTrip

    @property
    def trip(self) -> Trip | None:
        """The trip of a body that can move, otherwise None."""
        return self.placement if isinstance(self.placement, Trip) else None

    def world_from_body(self, time_s: float) -> AnyFloats:
        """Returns the (4, 4) pose at a time in seconds."""
        if isinstance(self.placement, Trip):
            return self.placement.pose(time_s)
        if isinstance(self.placement, SensorTrip):
            return self.placement.world_from_sensor(time_s)
        return self.placement
