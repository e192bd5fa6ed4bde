# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""PointCloud2 to sweep, and flow to PointCloud2, for live and recorded messages."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Bools, Floats32, Ints
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.settings import OutputSettings, TimeSettings
from mnsf_ros.sweeps.azimuth_times import AzimuthTimes, contradicted
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S, Sweep
from mnsf_ros.sweeps_io.flow_columns import chosen_columns, flow_columns, position_columns
from msg_utils.cdr import serialized_cloud
from msg_utils.cloud_layout import PointCloudLike
from msg_utils.point_cloud2 import decode_points, decode_xyz, encode_columns, encode_with_columns
from msg_utils.point_times import PointTimes, decode_times
from msg_utils.stamps import decode_stamp

_CLASH_PREFIX: Final = "sensor_"
_RING_FIELDS: Final = ("ring", "channel")
# The interval is the median of these.
_NUM_STAMPS: Final = 8


@dataclass(frozen=True, eq=False)
class CloudSource:
    """The cloud of a sweep, or the clouds of the parts of its revolution, one after the other."""

    message: Any  # a sensor_msgs/PointCloud2, or an object with its attributes; None if not kept
    measured: Bools  # (height * width,) points of the cloud that are in the sweep
    times: PointTimes  # of these points
    is_stamped: bool = True  # whether the message has a stamp
    num_untimed: int = 0  # points that were left out because their time cannot be right
    recording: str = ""  # its name
    parts: Sequence[Sweep] = ()  # each with its cloud, if several
    received_ns: int = 0  # when the message came, by the clock of the receiver; 0 if unknown

    @property
    def num_points(self) -> int:
        """Number of points of the cloud, also of those that are not in the sweep."""
        return len(self.measured)

    @property
    def rows(self) -> Ints:
        """(N,) row in the cloud of each point of the sweep."""
        return np.flatnonzero(self.measured)

    @property
    def rings(self) -> NDArray[np.integer[Any]] | None:
        """(N,) number of the beam of each point of the sweep; None if unknown."""
        if self.message is None:
            return joined_rings(self.parts) if self.parts else None
        points = decode_points(self.message).reshape(-1)
        names = [name for name in _RING_FIELDS if name in (points.dtype.names or ())]
        if not names or points.dtype[names[0]].kind not in "iu":
            return None
        return np.compress(self.measured, points[names[0]])

    @property
    def without_messages(self) -> "CloudSource":
        """For sweeps that are kept for long: messages have megabytes."""
        return replace(self, message=None, parts=())


def joined_rings(sweeps: Sequence[Sweep]) -> NDArray[np.integer[Any]] | None:
    """Returns (N,) the number of the beam of each point, if all sweeps know them."""
    known = [rings for sweep in sweeps if (rings := sweep.rings) is not None]
    return np.concatenate(known) if len(known) == len(sweeps) else None


class CloudReader:
    """Makes sweeps of the clouds of one lidar; estimates their interval from recent stamps."""

    def __init__(self) -> None:
        self._stamps_ns: deque[int] = deque(maxlen=_NUM_STAMPS)
        self._has_untimed = False

    def sweep(self, message: PointCloudLike, settings: TimeSettings, now_ns: int) -> Sweep:
        """Returns the measured points of a cloud, with a CloudSource as `source`.

        It was received at `now_ns`, 0 if unknown; a message without a stamp gets that one. Points
        without a usable time are left out, if the others have one.

        Raises:
            MessageError: If the message cannot be decoded.
        """
        xyz, measured = decode_xyz(message)
        own_stamp_ns = decode_stamp(message.header.stamp)
        stamp_ns = own_stamp_ns or now_ns
        self._stamps_ns.append(stamp_ns)
        if (rotation := settings.rotation) is None:
            times = decode_times(message, measured, stamp_ns, settings, self._interval_s)
        else:
            by_azimuth = AzimuthTimes(*rotation)
            times = PointTimes(by_azimuth.of(xyz, self._interval_s), f"azimuth, {by_azimuth}")
        num_untimed = 0
        if times.times_s is not None:
            timed = ~contradicted(xyz, times.times_s, is_likely=self._has_untimed)
            if not timed.all():
                self._has_untimed, num_untimed = True, int(np.count_nonzero(~timed))
                measured[measured] = timed
                xyz, times = xyz[timed], replace(times, times_s=times.times_s[timed])
        source = CloudSource(
            message, measured, times, own_stamp_ns != 0, num_untimed, received_ns=now_ns
        )
        return Sweep(xyz, stamp_ns, message.header.frame_id, source=source, times_s=times.times_s)

    @property
    def _interval_s(self) -> float:
        """The median interval; until the second cloud the usual interval of lidars."""
        interval_ns = float(np.median(np.diff(self._stamps_ns))) if len(self._stamps_ns) > 1 else 0
        return interval_ns / NANOSECONDS if interval_ns > 0 else USUAL_INTERVAL_S


def flow_cloud(
    sweep: Sweep,
    estimate: FlowEstimate,
    interval_s: float,
    output: OutputSettings,
    part: Bools | None = None,
    moved: Floats32 | None = None,
) -> bytes:
    """Returns the cloud of a sweep with the columns of its flow, serialized.

    Header, height, width and order of the points stay. The fields of the cloud come first, then
    those of FLOW_COLUMNS; a field of the cloud with the same name is renamed to `sensor_...`.
    The compact layout keeps only x, y and z of the cloud. With a mask `part` (N,) the cloud has
    only these points of the sweep, in one row. Positions `moved` (N, 3), metres, replace x, y, z.
    """
    source: CloudSource = sweep.source
    cloud, measured, rows = source.message, source.measured, None
    xyz, shape = sweep.xyz if moved is None else moved, (cloud.height, cloud.width)
    if part is not None:
        chosen = np.flatnonzero(part)
        rows, shape = np.flatnonzero(measured)[chosen], (1, len(chosen))
        xyz, estimate, measured = xyz[chosen], estimate.part(chosen), np.ones(len(chosen), np.bool_)
    columns = flow_columns(estimate, interval_s, measured, chosen_columns(output))
    if moved is not None or output.layout == "compact":
        columns = position_columns(xyz, measured) | columns
    if output.layout == "compact":
        encoded = encode_columns(columns, *shape)
    else:
        encoded = encode_with_columns(cloud, columns, clash_prefix=_CLASH_PREFIX, rows=rows)
    return serialized_cloud(cloud.header, encoded, is_dense=bool(measured.all()))
