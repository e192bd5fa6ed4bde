"""What every data set is turned into: sweeps with what is known about their motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.datasets.errors import DatasetError
from mnsf_ros.simulation.transforms import FloatArray


@dataclass(frozen=True, eq=False)
class Box:
    """A tracked object in one sweep.

    Attributes:
        pose: (4, 4) float64 `sweep_from_box`; the origin of the box is its middle, x its length.
        size_m: (3,) length, width and height in meters.
        class_id: Kind of surface, see `docs/recordings.md`.
        track_id: What the same object is called in other sweeps; None if its motion is unknown.
        hidden: Whether none of it was seen, so that points in it belong to something else.
    """

    pose: FloatArray
    size_m: NDArray[np.float64]
    class_id: int
    track_id: str | int | None
    hidden: bool = False


@dataclass(frozen=True, eq=False)
class GivenFlow:
    """Flow that a data set brings itself, row i for point i of its sweep.

    Attributes:
        flow: (N, 3) meters to the next sweep, in the next sweep's frame.
        valid: (N,) bool, the flow is known.
        dynamic: (N,) bool, the surface itself moves; None: find out from the flow.
        class_id: (N,) uint8 kind of surface; None: ask the boxes.
        background: (N,) bool, points that surely stand still, from whose flow the ego motion can
            be read; None: the poses tell it.
    """

    flow: NDArray[np.float32]
    valid: NDArray[np.bool_]
    dynamic: NDArray[np.bool_] | None = None
    class_id: NDArray[np.uint8] | None = None
    background: NDArray[np.bool_] | None = None


@dataclass(frozen=True, eq=False)
class LabelledSweep:
    """One sweep in the frame in which the data set has it, x to the front or not, z up.

    Attributes:
        stamp_ns: Time in nanoseconds.
        xyz: (N, 3) float32 meters.
        columns: More to write for each point: name -> (N,).
        pose: (4, 4) float64 `world_from_sweep`; None if the data set has none.
        boxes: Tracked objects; None if this sweep was not annotated.
        given: Flow of the data set's own; None: it follows from poses and boxes.
        labelled: (N,) bool, where an object would have been annotated; None: everywhere.
        ground: (N,) bool; None: find it.

    Raises:
        DatasetError: On construction, if an array does not fit.
    """

    stamp_ns: int
    xyz: NDArray[np.float32]
    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    pose: FloatArray | None = None
    boxes: tuple[Box, ...] | None = None
    given: GivenFlow | None = None
    labelled: NDArray[np.bool_] | None = None
    ground: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        """Checks that all arrays are about the same points."""
        if self.xyz.ndim != 2 or self.xyz.shape[1] != 3:
            raise DatasetError(f"{self._name}: xyz has shape {self.xyz.shape}, expected (N, 3)")
        rows = {**self.columns, "labelled": self.labelled, "ground": self.ground}
        if self.given is not None:
            rows |= {name: getattr(self.given, name) for name in _GIVEN_ROWS}
            self._check("flow", self.given.flow, self.xyz.shape)
        for name, column in rows.items():
            if column is not None:
                self._check(name, column, (len(self.xyz),))
        if self.pose is not None:
            self._check("pose", self.pose, (4, 4))
            if not np.isfinite(self.pose).all():
                raise DatasetError(f"{self._name}: its pose is not finite: {self.pose.tolist()}")

    def __len__(self) -> int:
        """Returns the number of points."""
        return len(self.xyz)

    @property
    def _name(self) -> str:
        return f"sweep of stamp {self.stamp_ns}"

    def _check(self, name: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
        if array.shape != shape:
            raise DatasetError(f"{self._name}: {name} has shape {array.shape}, expected {shape}")


_GIVEN_ROWS = ("valid", "dynamic", "class_id", "background")


@dataclass(frozen=True)
class SweepSource:
    """The sweeps of one sequence, read one after the other while they are asked for.

    Attributes:
        frame_id: Name of the frame that the points are in.
        num_sweeps: How many there are; None if only reading them tells.
        sweeps: In the order of their stamps; can be iterated once.
    """

    frame_id: str
    num_sweeps: int | None
    sweeps: Iterable[LabelledSweep]

    def part(self, first: int = 0, count: int | None = None) -> SweepSource:
        """Returns the sweeps from number `first` on, counted from 0, at most `count` of them.

        Raises:
            DatasetError: If there are none.
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
