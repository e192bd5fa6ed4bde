"""Rigid things of the scene: what they are made of and where they are."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from mnsf_ros.simulation.routes import Trip

if TYPE_CHECKING:
    from mnsf_ros.geometry.transforms import FloatArray
    from mnsf_ros.simulation.shapes import Shape


class SurfaceClass(IntEnum):
    """What a point belongs to; the numbers are written to recordings and never reused."""

    ROAD = 1
    SIDEWALK = 2
    BUILDING = 3
    POLE = 4
    VEGETATION = 5
    CAR = 6
    PEDESTRIAN = 7
    CYCLIST = 8
    STREET_FURNITURE = 9
    LARGE_VEHICLE = 10  # bus, truck, trailer, tram
    OBSTACLE = 11  # cone, barrel, sign: what a data set labels as objects, though they stand
    ANIMAL = 12


@dataclass(frozen=True)
class Model:
    """A thing in its own frame: x forward, y left, z up, the origin on the ground.

    Attributes:
        surface_class: What its points are.
        shapes: The solids it is made of.
        length_m: Extent along x that nothing else may enter, centered on the origin.
        width_m: The same along y.
        reflectivity: Mean intensity of its points, 0 to 255.
    """

    surface_class: SurfaceClass
    shapes: tuple[Shape, ...]
    length_m: float
    width_m: float
    reflectivity: float


@dataclass(frozen=True)
class Body:
    """A model placed in the world: at rest at a (4, 4) `world_from_body`, or on a trip."""

    model: Model
    placement: FloatArray | Trip

    @property
    def trip(self) -> Trip | None:
        """The trip of a body that can move, otherwise None."""
        return self.placement if isinstance(self.placement, Trip) else None

    def world_from_body(self, time_s: float) -> FloatArray:
        """Return the (4, 4) pose at a time in seconds."""
        if isinstance(self.placement, Trip):
            return self.placement.pose(time_s)
        return self.placement
