"""The truth of one sweep after the other, read along with them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from mnsf_ros.errors import RecordingError
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.stamp_order import REORDER_WINDOW, in_stamp_order
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.recording.readable_messages import readable_messages
from msg_utils.errors import MessageError
from msg_utils.stamps import decode_stamp


@dataclass(frozen=True, eq=False)
class TruthCloud:
    """A truth cloud that is decoded only if a sweep wants it.

    Attributes:
        stamp_ns: Its header stamp, integer nanoseconds.
        message: The sensor_msgs/PointCloud2.
    """

    stamp_ns: int
    message: Any


def truth_clouds(reader: BagReader, topic: str, findings: Findings) -> Iterator[TruthCloud]:
    """Yields the truth clouds of a topic as they were received."""
    for item in readable_messages(reader, topic):
        if isinstance(item, Damage):
            findings.report(item)
            continue
        try:
            yield TruthCloud(decode_stamp(item[1].header.stamp), item[1])
        except MessageError as error:
            findings.report(Damage(str(reader.path), f"on {topic!r}", str(error)))


class TruthTrack:
    """Finds the truth of sweeps that come in stamp order; holds a few clouds at a time."""

    def __init__(self, clouds: Iterable[TruthCloud], findings: Findings, name: str) -> None:
        """Starts before the first cloud.

        Args:
            clouds: Truth clouds, about in stamp order.
            findings: Gets what cannot be decoded.
            name: What to call the recording in reports.
        """
        self._clouds = in_stamp_order(clouds)
        self._findings = findings
        self._name = name
        self._head = next(self._clouds, None)
        self._last_ns: int | None = None

    def take(self, stamp_ns: int, num_points: int) -> tuple[FlowTruth | None, int]:
        """Returns the truth of a sweep, and how many clouds were passed over to find it.

        A cloud that was passed over tells that its sweep is missing in between.

        Args:
            stamp_ns: Stamp of the sweep.
            num_points: Points of its cloud, before any of them are left out.
        """
        if self._last_ns is not None and stamp_ns < self._last_ns:
            self._skip_leftovers(self._last_ns)
        self._last_ns = stamp_ns
        passed_over = 0
        while self._head is not None and self._head.stamp_ns < stamp_ns:
            self._head = next(self._clouds, None)
            passed_over += 1
        if self._head is None or self._head.stamp_ns != stamp_ns:
            return None, passed_over
        cloud, self._head = self._head, next(self._clouds, None)
        return self._decoded(cloud, num_points), passed_over

    def _skip_leftovers(self, last_ns: int) -> None:
        """Follows a jump back in time, past a few clouds that no sweep has asked for."""
        # Not past all: a single sweep with a wrong stamp must not cost the others their truth.
        for _ in range(REORDER_WINDOW):
            if self._head is not None and self._head.stamp_ns > last_ns:
                self._head = next(self._clouds, None)

    def _decoded(self, cloud: TruthCloud, num_points: int) -> FlowTruth | None:
        try:
            truth = FlowTruth.decode(cloud.message)
            if len(truth) != num_points:
                raise RecordingError(
                    f"truth has {len(truth)} rows, its sweep has {num_points} points"
                )
        except RecordingError as error:
            where = f"truth at stamp {cloud.stamp_ns}"
            self._findings.report(Damage(self._name, where, str(error)))
            return None
        return truth
