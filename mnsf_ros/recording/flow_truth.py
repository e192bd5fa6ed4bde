# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""True flow of a sweep, and the sweep with it, see `docs/recordings.md`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import AnyFloats, Bools, Floats32, Ints
from mnsf_ros.errors import RecordingError
from msg_utils.cloud_layout import EncodedCloud, PointCloudLike
from msg_utils.errors import MessageError
from msg_utils.point_cloud2 import decode_points, encode_columns
from msg_utils.stamps import decode_stamp

_FLOW = ("flow_x", "flow_y", "flow_z")
_FLAGS = ("valid", "dynamic", "ground", "class_id")
_OBJECT = "object_id"
_ARRAYS = ("flow", *_FLAGS, _OBJECT)
_SCALARS = (*"xyz", *_FLOW, *_FLAGS, _OBJECT)
# The usual threshold for a moving point: 0.05 m within one sweep at 10 Hz.
DYNAMIC_SPEED_M_S = 0.5
# Nothing on earth moves as far from one sweep to the next.
_MAX_FLOW_M = 1000.0


class SurfaceClass(IntEnum):
    """Class of the surface of a point; the numbers are in recordings and never reused."""

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
    OBSTACLE = 11  # cone, barrel, sign: labelled as objects, but static
    ANIMAL = 12
    OWN_BODY = 13  # of the robot: fixed to the sensor, its flow is not valid


@dataclass(frozen=True, eq=False)
class FlowTruth:
    """True flow of the N points of one sweep, row i for point i of its cloud.

    Flow leads from a point to the position of its surface in the next sweep, in the next sweep's
    sensor frame: ego motion is part of it.
    """

    stamp_ns: int  # of the header of the sweep
    flow: Floats32  # (N, 3) metres; NaN if not valid
    valid: Bools  # (N,) the flow of the point is known
    dynamic: Bools  # (N,) the surface itself moves, faster than DYNAMIC_SPEED_M_S
    ground: Bools  # (N,) the point is on the ground
    class_id: NDArray[np.uint8]  # (N,) `SurfaceClass`, 0 if unknown
    object_id: NDArray[np.uint32] | None = None  # (N,) the same in all sweeps, 0 for no object

    def __len__(self) -> int:
        """Returns the number of points."""
        return len(self.flow)

    def of_points(self, rows: Ints) -> "FlowTruth":
        """Returns the truth of the points in these rows."""
        known = {name: getattr(self, name) for name in _ARRAYS}
        return replace(self, **{k: array[rows] for k, array in known.items() if array is not None})

    @classmethod
    def joined(cls, parts: Sequence["FlowTruth"]) -> "FlowTruth":
        """Returns the truth of the points of all parts, with the stamp of the first."""
        columns = {name: [getattr(part, name) for part in parts] for name in _ARRAYS}
        if any(column is None for column in columns[_OBJECT]):
            del columns[_OBJECT]
        return cls(parts[0].stamp_ns, **{k: np.concatenate(each) for k, each in columns.items()})

    def encode(self, xyz: AnyFloats) -> EncodedCloud:
        """Returns the truth and the (N, 3) points, metres, as a cloud that viewers can show.

        Raises:
            RecordingError: The numbers of points differ.
        """
        if len(xyz) != len(self):
            raise RecordingError(f"truth has {len(self)} rows for a sweep of {len(xyz)} points")
        flow = np.where(self.valid[:, None], self.flow, np.float32(np.nan))
        columns: dict[str, NDArray[Any]] = {
            name: np.asarray(xyz[:, axis], dtype=np.float32) for axis, name in enumerate("xyz")
        }
        columns |= {name: flow[:, axis] for axis, name in enumerate(_FLOW)}
        columns |= {name: getattr(self, name).astype(np.uint8) for name in _FLAGS}
        if self.object_id is not None:
            columns[_OBJECT] = self.object_id.astype(np.uint32)
        return encode_columns(columns, 1, len(self))

    @classmethod
    def decode(cls, message: PointCloudLike) -> "FlowTruth":
        """Returns the truth in a sensor_msgs/PointCloud2.

        Raises:
            RecordingError: The cloud is damaged, lacks a field, or has a valid row whose flow is
                not finite or is too large.
        """
        try:
            stamp_ns = decode_stamp(message.header.stamp)
            points = decode_points(message).ravel()
        except MessageError as error:
            raise RecordingError(f"truth cloud cannot be decoded: {error}") from error
        names = points.dtype.names or ()
        missing = [name for name in (*_FLOW, *_FLAGS) if name not in names]
        if missing:
            raise RecordingError(
                f"truth cloud has no field {', '.join(missing)}; it has {', '.join(names)}"
            )
        wide = [name for name in names if name in _SCALARS and points.dtype[name].shape]
        if wide:
            raise RecordingError(
                f"truth cloud: field {', '.join(wide)} has more than one value a point"
            )
        flow = np.stack([points[name].astype(np.float32) for name in _FLOW], axis=1)
        valid = points["valid"] != 0
        bad = np.flatnonzero(valid & ~(np.abs(flow) < _MAX_FLOW_M).all(axis=1))
        if len(bad):
            raise RecordingError(
                f"truth cloud: row {bad[0]} is valid but its flow is {flow[bad[0]]} m"
            )
        if _OBJECT in names and points.dtype[_OBJECT].kind not in "iu":
            raise RecordingError(
                f"truth cloud: field {_OBJECT} is of {points.dtype[_OBJECT]}, expected integers"
            )
        dynamic, ground = points["dynamic"] != 0, points["ground"] != 0
        class_id = points["class_id"].astype(np.uint8)
        object_id = points[_OBJECT].astype(np.uint32) if _OBJECT in names else None
        return cls(stamp_ns, flow, valid, dynamic, ground, class_id, object_id)


@dataclass(frozen=True, eq=False)
class TrueSweep:
    """A sweep with its truth, as in a recording."""

    xyz: Floats32  # (N, 3) metres, sensor frame
    truth: FlowTruth  # row for row; its stamp is that of the sweep
    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)  # further ones, (N,) each
    pose: AnyFloats | None = None  # (4, 4) world_from_sensor at the stamp
