# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps of any data set with their labels."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import AnyFloats, Bools, Floats, Floats32
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import is_rigid
from mnsf_ros.recording.flow_truth import SurfaceClass

# Beyond the range of any lidar: larger coordinates are damage.
_FARTHEST_M: Final = 1e6
_MASKS: Final = ("flow_valid", "dynamic", "class_id", "labelled", "ground", "own_vehicle")


def classes_of(**names: str) -> dict[str, int]:
    """Returns category to class, for texts with the categories of each class; 0 is unknown."""
    return {
        name: int(SurfaceClass[surface.upper()])
        for surface, listed in names.items()
        for name in listed.split(", ")
    }


@dataclass(frozen=True, eq=False)
class Box:
    """A tracked object in one sweep.

    Raises:
        ValueError: The pose is not a rigid motion, a size is not above 0, or the track has another
            type.
    """

    pose: AnyFloats  # (4, 4) `sweep_from_box`; its origin is the middle of the box, x its length
    size_m: Floats  # (3,) length, width and height
    class_id: int  # see `SurfaceClass`; 0 if unknown
    track_id: str | int | None  # the same in all sweeps; None if its motion is unknown
    hidden: bool = False  # it has no points, for example because it is fully occluded

    def __post_init__(self) -> None:
        name = f"box of track {self.track_id!r}"
        if not isinstance(self.track_id, str | int | None):
            raise ValueError(f"{name}: expected a text or an integer")
        if not is_rigid(self.pose):
            raise ValueError(f"{name}: its pose is no rigid motion: {self.pose.tolist()}")
        # Comparisons with NaN are false.
        if self.size_m.shape != (3,) or not ((self.size_m > 0) & (self.size_m < np.inf)).all():
            raise ValueError(f"{name}: its size is {self.size_m.tolist()}, expected 3 above 0")


@dataclass(frozen=True, eq=False)
class LabelledSweep:
    """One sweep in the frame of the data set, z up, with its labels: boxes, or flow.

    Raises:
        ValueError: An array does not fit, a coordinate is beyond the range of any lidar, or the
            pose is not a rigid motion. Rows that are not finite are allowed.
    """

    stamp_ns: int
    xyz: Floats32  # (N, 3) metres
    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)  # further ones, (N,) each
    pose: AnyFloats | None = None  # (4, 4) `world_from_sweep`; None if the data set has none
    boxes: tuple[Box, ...] | None = None  # None if the sweep was not annotated
    # (N, 3) metres to the next sweep, in the next sweep's frame; None: by poses and boxes.
    flow: Floats32 | None = None
    flow_valid: Bools | None = None  # (N,) the given flow is known; None: everywhere
    dynamic: Bools | None = None  # (N,) the surface itself moves; None: by the flow
    class_id: NDArray[np.uint8] | None = None  # (N,) `SurfaceClass`; None: that of its box
    labelled: Bools | None = None  # (N,) inside the annotated area; None: all points
    ground: Bools | None = None  # (N,); None: to be segmented
    own_vehicle: Bools | None = None  # (N,) returns of the vehicle with the lidar

    def __post_init__(self) -> None:
        name = f"sweep of stamp {self.stamp_ns}"
        if self.xyz.ndim != 2 or self.xyz.shape[1] != 3:
            raise ValueError(f"{name}: xyz has shape {self.xyz.shape}, expected (N, 3)")
        astray = self.xyz[np.isfinite(self.xyz) & (np.abs(self.xyz) > _FARTHEST_M)]
        if len(astray):
            raise ValueError(f"{name}: a point has the coordinate {astray[0]:.4g} m")
        expected = dict.fromkeys((*self.columns, *_MASKS), (len(self),)) | {"flow": (len(self), 3)}
        for array_name, shape in expected.items():
            array = self.columns.get(array_name, getattr(self, array_name, None))
            if array is not None and array.shape != shape:
                raise ValueError(f"{name}: {array_name} has shape {array.shape}, expected {shape}")
        if self.pose is not None and not is_rigid(self.pose):
            raise ValueError(f"{name}: its pose is no rigid motion: {self.pose.tolist()}")

    def __len__(self) -> int:
        """Returns the number of points."""
        return len(self.xyz)


@dataclass(frozen=True)
class SweepSource:
    """The sweeps of one sequence, read one at a time."""

    frame_id: str  # of the points
    num_sweeps: int
    sweeps: Iterable[LabelledSweep]  # in the order of their stamps; can be iterated once
    note: str = ""  # a warning for the user; may be empty

    def part(self, first: int = 0, count: int | None = None) -> "SweepSource":
        """Returns the sweeps from number `first` on, counted from 0, at most `count` of them.

        Raises:
            DatasetError: There are none.
        """
        if first < 0 or (count is not None and count < 1):
            raise DatasetError(f"first {first} and count {count}: expected at least 0 and 1")
        if first >= self.num_sweeps:
            raise DatasetError(f"first {first}: there are only {self.num_sweeps} sweeps")
        end = self.num_sweeps if count is None else min(first + count, self.num_sweeps)
        return replace(self, num_sweeps=end - first, sweeps=islice(self.sweeps, first, end))
