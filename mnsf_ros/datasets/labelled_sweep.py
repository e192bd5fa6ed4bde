# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps of any data set with their labels."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import FloatArray, is_rigid
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

    Attributes:
        pose: (4, 4) float64 `sweep_from_box`; the origin of the box is its middle, x its length.
        size_m: (3,) length, width and height.
        class_id: Class of the surface, see `docs/recordings.md`.
        track_id: Name of the object in all sweeps; None if its motion is unknown.
        hidden: Whether the object has no points, for example because it is fully occluded.

    Raises:
        ValueError: The pose is not a rigid motion, a size is not above 0, or the track has another
            type.
    """

    pose: FloatArray
    size_m: NDArray[np.float64]
    class_id: int
    track_id: str | int | None
    hidden: bool = False

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

    Attributes:
        stamp_ns: Time in nanoseconds.
        xyz: (N, 3) float32 metres.
        columns: Further columns of the cloud: name to (N,).
        pose: (4, 4) float64 `world_from_sweep`; None if the data set has none.
        boxes: Tracked objects; None if the sweep was not annotated.
        flow: (N, 3) float32 metres to the next sweep, in the next sweep's frame; None: by poses and
            boxes.
        flow_valid: (N,) bool, the given flow is known; None: everywhere.
        dynamic: (N,) bool, the surface itself moves; None: by the flow.
        class_id: (N,) uint8 class of the surface; None: that of its box.
        labelled: (N,) bool, inside the annotated area; None: all points.
        ground: (N,) bool; None: to be segmented.
        own_vehicle: (N,) bool, returns of the vehicle that carries the lidar; None: no point.

    Raises:
        ValueError: An array does not fit, a coordinate is beyond the range of any lidar, or the
            pose is not a rigid motion. Rows that are not finite are allowed.
    """

    stamp_ns: int
    xyz: NDArray[np.float32]
    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    pose: FloatArray | None = None
    boxes: tuple[Box, ...] | None = None
    flow: NDArray[np.float32] | None = None
    flow_valid: NDArray[np.bool_] | None = None
    dynamic: NDArray[np.bool_] | None = None
    class_id: NDArray[np.uint8] | None = None
    labelled: NDArray[np.bool_] | None = None
    ground: NDArray[np.bool_] | None = None
    own_vehicle: NDArray[np.bool_] | None = None

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
    """The sweeps of one sequence, read one at a time.

    Attributes:
        frame_id: Frame of the points.
        num_sweeps: Number of sweeps.
        sweeps: Sweeps in the order of their stamps; can be iterated once.
        note: A warning for the user; may be empty.
    """

    frame_id: str
    num_sweeps: int
    sweeps: Iterable[LabelledSweep]
    note: str = ""

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
