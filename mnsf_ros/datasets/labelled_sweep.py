# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps of any data set with their labels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import FloatArray, is_rigid

# Beyond the range of any lidar: the number of a damaged file.
_FARTHEST_M: Final = 1e6


@dataclass(frozen=True, eq=False)
class Box:
    """A tracked object in one sweep.

    Attributes:
        pose: (4, 4) float64 `sweep_from_box`; the origin of the box is its middle, x its length.
        size_m: (3,) length, width and height in metres.
        class_id: Class of the surface, see `docs/recordings.md`.
        track_id: Name of the object in all sweeps; None if its motion is unknown.
        hidden: Whether the object was fully occluded: points in the box are not its own.

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
        """Checks for silent errors of the flow."""
        name = f"box of track {self.track_id!r}"
        if not isinstance(self.track_id, str | int | None):
            raise ValueError(f"{name}: expected a text or an integer")
        if not is_rigid(self.pose):
            raise ValueError(f"{name}: its pose is no rigid motion: {self.pose.tolist()}")
        # Comparisons with NaN are false.
        if self.size_m.shape != (3,) or not ((self.size_m > 0) & (self.size_m < np.inf)).all():
            raise ValueError(f"{name}: its size is {self.size_m.tolist()}, expected 3 above 0")


@dataclass(frozen=True, eq=False)
class GivenFlow:
    """Flow labels of a data set, row i for point i of its sweep.

    Attributes:
        flow: (N, 3) metres to the next sweep, in the next sweep's frame.
        valid: (N,) bool, the flow is known.
        dynamic: (N,) bool, the surface itself moves; None: derived from the flow.
        class_id: (N,) uint8 class of the surface; None: that of its box.
        next_from_current: (4, 4) float64 rigid motion of static points by the flow; None: by the
            poses.
    """

    flow: NDArray[np.float32]
    valid: NDArray[np.bool_]
    dynamic: NDArray[np.bool_] | None = None
    class_id: NDArray[np.uint8] | None = None
    next_from_current: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class LabelledSweep:
    """One sweep in the frame of the data set, z up, with its labels.

    Attributes:
        stamp_ns: Time in nanoseconds.
        xyz: (N, 3) float32 metres.
        columns: Further columns of the cloud: name to (N,).
        pose: (4, 4) float64 `world_from_sweep`; None if the data set has none.
        boxes: Tracked objects; None if the sweep was not annotated.
        given: Flow labels; None: the flow follows from poses and boxes.
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
    given: GivenFlow | None = None
    labelled: NDArray[np.bool_] | None = None
    ground: NDArray[np.bool_] | None = None
    own_vehicle: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        """Checks shapes, range and pose."""
        if self.xyz.ndim != 2 or self.xyz.shape[1] != 3:
            raise ValueError(f"{self._name}: xyz has shape {self.xyz.shape}, expected (N, 3)")
        astray = self.xyz[np.isfinite(self.xyz) & (np.abs(self.xyz) > _FARTHEST_M)]
        if len(astray):
            raise ValueError(f"{self._name}: a point has the coordinate {astray[0]:.4g} m")
        masks = {"labelled": self.labelled, "ground": self.ground, "own_vehicle": self.own_vehicle}
        rows = {**self.columns, **masks}
        if (given := self.given) is not None:
            self._check("flow", given.flow, self.xyz.shape)
            rows |= {"valid": given.valid, "dynamic": given.dynamic, "class_id": given.class_id}
        for name, column in rows.items():
            if column is not None:
                self._check(name, column, (len(self.xyz),))
        if self.pose is not None and not is_rigid(self.pose):
            raise ValueError(f"{self._name}: its pose is no rigid motion: {self.pose.tolist()}")

    def __len__(self) -> int:
        """Returns the number of points."""
        return len(self.xyz)

    @property
    def _name(self) -> str:
        return f"sweep of stamp {self.stamp_ns}"

    def _check(self, name: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
        if array.shape != shape:
            raise ValueError(f"{self._name}: {name} has shape {array.shape}, expected {shape}")


@dataclass(frozen=True)
class SweepSource:
    """The sweeps of one sequence, read one at a time.

    Attributes:
        frame_id: Frame of the points.
        num_sweeps: Number of sweeps; None if unknown before they are read.
        sweeps: Sweeps in the order of their stamps; can be iterated once.
    """

    frame_id: str
    num_sweeps: int | None
    sweeps: Iterable[LabelledSweep]

    def part(self, first: int = 0, count: int | None = None) -> SweepSource:
        """Returns the sweeps from number `first` on, counted from 0, at most `count` of them.

        Raises:
            DatasetError: There are none.
        """
        if first < 0 or (count is not None and count < 1):
            raise DatasetError(f"first {first} and count {count}: expected at least 0 and 1")
        num_sweeps = self.num_sweeps
        if num_sweeps is not None:
            if first >= num_sweeps:
                raise DatasetError(f"first {first}: there are only {num_sweeps} sweeps")
            num_sweeps = min(num_sweeps - first, num_sweeps if count is None else count)
        stop = None if count is None else first + count
        return SweepSource(self.frame_id, num_sweeps, islice(self.sweeps, first, stop))
