# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps, truth, poses and turn rates of a recording, read together as they were received.

What is noticed on the way is counted in Findings.
"""

import math
from bisect import insort
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from operator import attrgetter
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.errors import RecordingError
from mnsf_ros.geometry.pose_track import PoseTrack, StampedPose
from mnsf_ros.geometry.stamped_rate import StampedRate
from mnsf_ros.geometry.transforms import sensor_mount, transform_matrix
from mnsf_ros.input_check.input_check import InputCheck
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import IMU_TYPE, TF_TYPE
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.recording.static_frames import StaticFrames
from mnsf_ros.recording.storage_file import Damage
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.mounting_estimate import MountingEstimate
from mnsf_ros.sweeps.rate_track import RateTrack, are_covered
from mnsf_ros.sweeps.revolutions import Revolutions
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps_io.flow_cloud import CloudReader, CloudSource
from mnsf_ros.sweeps_io.several_lidars import joined_rings, joined_times, revolution_sweep
from msg_utils.errors import MessageError
from msg_utils.point_cloud2 import decode_points
from msg_utils.stamps import decode_stamp

# Messages that are looked at ahead to put them in the order of their header stamps.
_ORDER_WINDOW: Final = 4
# Enough of a recording that is damaged from end to end.
_MAX_DAMAGES: Final = 100


class Event(str, Enum):
    """An event that is counted while a recording is read, as `run.json` and notes name it.

    Those of an `Arrival` have its name.
    """

    SWEEPS_UNSTAMPED = "sweeps without a stamp; the time of reception was used"
    SWEEPS_TIMES_UNUSED = (
        "sweeps whose times per point cannot be read; they count as taken in one moment "
        "(time.field, time.unit)"
    )
    POINTS_UNTIMED = "points whose time is not of their sweep, left out"
    SWEEPS_WITHOUT_TRUTH = "sweeps without truth"
    SWEEPS_WITHOUT_POSE = "sweeps without odometry"
    DUPLICATE = "sweeps with the stamp of the previous sweep, skipped"
    OUT_OF_ORDER = "sweeps older than the previous sweep, skipped"
    TIME_WENT_BACK = "jumps back in time; no triplet spans them"
    GAP = "gaps in time; no triplet spans them"
    FRAME_CHANGED = "changes of frame_id; no triplet spans them"
    INTERRUPTIONS = "missing sweeps; no triplet spans the gap"
    TRUTH_WITHOUT_SWEEP = "truth clouds without a sweep"
    TRUTH_UNFIT = "truth clouds that do not match their sweep or cannot be read, not used"
    TRUTH_REORDERED = "truth clouds whose rows have another order, matched by position"
    TRUTH_ROWS_UNFIT = "points whose position is not in their truth, without truth"
    TRUTH_ROWS_COMPARED = "points of the sweeps with such points"
    PARTS = "clouds that are parts of a revolution, put together"
    LEVELLED = (
        "sweeps of a lidar that is tilted, upside down, or not at the origin; turned upright for "
        "methods (lidar_1.roll_deg, lidar_1.pitch_deg)"
    )
    SWEEPS_WITHOUT_RATES = (
        "sweeps without turn rates: those of the IMU have gaps, or stamps of another clock"
    )
    IMU_UNPLACED = (
        "sweeps whose IMU is not used: /tf_static does not connect its frame with that of clouds"
    )
    FRAMES_DIFFER = (
        "sweeps whose frame is not the odometry's child frame; set ego_motion.sensor_x_m to "
        "sensor_yaw_deg to where the sensor is mounted"
    )


@dataclass
class Findings:
    """Counts and damage of one pass over a recording.

    Attributes:
        counts: Event to number of occurrences.
        damages: Unreadable parts, each place once.
        mounting: How the sensor is mounted.
        input_check: Gets each cloud; None if the input is not checked.
    """

    counts: Counter[Event] = field(default_factory=Counter)
    damages: dict[Damage, None] = field(default_factory=dict)
    mounting: MountingEstimate = field(default_factory=MountingEstimate)
    input_check: InputCheck | None = None

    def count(self, event: Event, times: int = 1) -> None:
        """Counts an event."""
        if times:
            self.counts[event] += times

    def report(self, damage: Damage) -> None:
        """Notes damage; several passes over a file find the same."""
        if len(self.damages) < _MAX_DAMAGES:
            self.damages.setdefault(damage)


Item = TypeVar("Item", Sweep, StampedPose, StampedRate, "TruthCloud")


@dataclass(frozen=True, eq=False)
class CloudRows:
    """Rows of a sweep in the recorded cloud; the `source` of a recorded sweep.

    Attributes:
        rows: (N,) row of each point of the sweep, counted row by row in the cloud.
        num_points: Points of the cloud, also those that are not in the sweep.
        recording: Name of the recording.
        rings: (N,) number of the beam of each point; None if unknown.
        parts: The clouds of the revolution, if it has several; rows go on from one to the next.
    """

    rows: NDArray[np.int64]
    num_points: int
    recording: str = ""
    rings: NDArray[np.integer[Any]] | None = None
    parts: Sequence[Sweep] = ()


def recorded_sweeps(
    reader: BagReader, topic: str, recording: str, settings: Settings, findings: Findings
) -> Iterator[Sweep | None]:
    """Yields the sweeps of `recorded_clouds` without their messages: `source` is a CloudRows."""
    imu = _RecordedImu(reader, settings, findings)
    for parts in _recorded_revolutions(reader, topic, settings, findings):
        yield imu.turning(_with_rows(parts, recording)) if parts else None


def recorded_clouds(
    reader: BagReader, topic: str, settings: Settings, findings: Findings
) -> Iterator[Sweep | None]:
    """Yields the measured points of each revolution of a topic, `source` a CloudSource.

    None marks a gap; findings collect damage.
    """
    imu = _RecordedImu(reader, settings, findings)
    for parts in _recorded_revolutions(reader, topic, settings, findings):
        yield imu.turning(revolution_sweep(parts)) if parts else None


class _RecordedImu:
    """Adds turn rates to sweeps: of the first IMU whose rotation to the lidar is known."""

    def __init__(self, reader: BagReader, settings: Settings, findings: Findings) -> None:
        is_used = settings.ego_motion.imu
        topics = [name for name, one in reader.topics.items() if one.has_messages(IMU_TYPE)]
        self._tracks = [
            RateTrack(_decoded(reader, topic, findings, lambda imu, _: StampedRate.of(imu)))
            for topic in topics
            if is_used
        ]
        self._frames = StaticFrames(reader) if self._tracks else None
        self._findings = findings

    def turning(self, sweep: Sweep) -> Sweep:
        """Returns the sweep with its turn rates, if they are known."""
        if self._frames is None:
            return sweep
        for track in self._tracks:
            rates = track.around(sweep)
            pose = self._frames.find(sweep.frame_id, track.frame_id)
            if pose is not None:
                is_covered = are_covered(rates, *sweep.span_s)
                self._findings.count(Event.SWEEPS_WITHOUT_RATES, int(not is_covered))
                return sweep.turning(rates, pose)
        self._findings.count(Event.IMU_UNPLACED)
        return sweep


def _recorded_revolutions(
    reader: BagReader, topic: str, settings: Settings, findings: Findings
) -> Iterator[Sequence[Sweep]]:
    """Revolutions, each as its parts, in order; none for a gap."""
    clouds = CloudReader()

    def sweep_of(message: Any, received_ns: int) -> Sweep:  # noqa: ANN401 - a PointCloud2
        sweep = clouds.sweep(message, settings.time, received_ns)
        cloud: CloudSource = sweep.source
        findings.count(Event.SWEEPS_UNSTAMPED, int(not cloud.is_stamped))
        findings.count(Event.SWEEPS_TIMES_UNUSED, int(bool(cloud.times.fault)))
        findings.count(Event.POINTS_UNTIMED, cloud.num_untimed)
        return sweep

    revolutions = Revolutions()
    for cloud in _decoded(reader, topic, findings, sweep_of):
        found = [()] if cloud is None else revolutions.add(cloud, settings.buffer)
        for parts in found:
            if cloud is not None and not parts:
                # It was of a part.
                findings.mounting.forget()
            findings.count(Event.PARTS, len(parts) if len(parts) > 1 else 0)
            yield _checked(parts, findings)
    if revolutions.rest:
        yield _checked(revolutions.rest, findings)


def _checked(parts: Sequence[Sweep], findings: Findings) -> Sequence[Sweep]:
    if findings.input_check is not None:
        for part in parts:
            findings.input_check.add(part, len(parts))
    return parts


def _with_rows(parts: Sequence[Sweep], recording: str) -> Sweep:
    """The parts as one sweep with the stamp of the first, and a CloudRows."""
    clouds = []
    for part in parts:
        measured = part.source.measured
        source = CloudRows(np.flatnonzero(measured), len(measured), recording, part.rings)
        clouds.append(replace(part, source=source))
    first = clouds[0]
    if len(clouds) == 1:
        return first
    starts = np.cumsum([0, *(cloud.source.num_points for cloud in clouds)])
    rows = [cloud.source.rows + start for cloud, start in zip(clouds, starts, strict=False)]
    source = CloudRows(
        np.concatenate(rows), int(starts[-1]), recording, joined_rings(clouds), clouds
    )
    return replace(
        first,
        xyz=np.concatenate([cloud.xyz for cloud in clouds]),
        times_s=joined_times(clouds, first.stamp_ns),
        source=source,
    )


def recorded_poses(
    reader: BagReader, topic: str, fixed_frame: str, findings: Findings
) -> Iterator[StampedPose | None]:
    """Yields the poses of an odometry topic as received, None for a gap.

    Of a topic of transforms they are those of the first frame that moves in the fixed frame.
    """
    child = ""

    def transform_of(message: Any, _: int) -> StampedPose | None:  # noqa: ANN401 - a TFMessage
        nonlocal child
        for one in message.transforms:
            names = one.header.frame_id.lstrip("/"), one.child_frame_id.lstrip("/")
            if names[0] == fixed_frame and names[1] == (child or names[1]):
                child = names[1]
                return StampedPose(
                    decode_stamp(one.header.stamp), transform_matrix(one.transform), child
                )
        return None

    if reader.topics[topic].msgtype == TF_TYPE:
        return _decoded(reader, topic, findings, transform_of)
    return _decoded(reader, topic, findings, lambda message, _: StampedPose.of(message))


def recorded_track(
    reader: BagReader, topic: str | None, settings: Settings, findings: Findings
) -> PoseTrack:
    """Returns the poses of the sensor, by those of a topic; without one there are none."""
    fixed_frame = settings.tf.fixed_frame
    recorded = () if topic is None else recorded_poses(reader, topic, fixed_frame, findings)
    return PoseTrack(recorded, sensor_mount(settings.ego_motion))


def _decoded(
    reader: BagReader, topic: str, findings: Findings, decode: Callable[[Any, int], Item | None]
) -> Iterator[Item | None]:
    """Decoded messages in the order of their stamps, see `_in_stamp_order`; None for damage."""
    return _in_stamp_order(_as_received(reader, topic, findings, decode))


def _as_received(
    reader: BagReader, topic: str, findings: Findings, decode: Callable[[Any, int], Item | None]
) -> Iterator[Item | None]:
    """Decoded messages in the order of the recording, without those of None; None for damage."""
    for number, item in enumerate(reader.readable_messages(topic)):
        if isinstance(item, Damage):
            if item.is_memory:
                raise item.error()  # the file is intact, and a larger limit reads it
            findings.report(item)
            yield None
            continue
        received_ns, message = item
        try:
            decoded = decode(message, received_ns)
        except MessageError as error:
            where = f"message {number} on {topic!r}"
            findings.report(Damage(str(reader.path), where, str(error)))
            yield None
            continue
        if decoded is not None:
            yield decoded


def _in_stamp_order(items: Iterator[Item | None]) -> Iterator[Item | None]:
    """Items in the order of their stamps within a window; a gap or a larger step back ends it."""
    window: list[Item] = []
    last_ns = -math.inf
    for item in items:
        if item is None or item.stamp_ns < last_ns:
            yield from window
            window.clear()
            last_ns = -math.inf
        if item is None:
            yield None
            continue
        insort(window, item, key=attrgetter("stamp_ns"))
        if len(window) > _ORDER_WINDOW:
            oldest = window.pop(0)
            last_ns = oldest.stamp_ns
            yield oldest
    yield from window


# Above the rounding of stamps as floating point numbers, below the interval of any lidar.
_SAME_STAMP_NS: Final = 500_000
_SAME_POINT_M: Final = 1e-3
# A lossy codec changes less, the truth of another sweep differs nearly everywhere.
_MAX_UNFIT: Final = 0.1
# All truth of a recording may be unfit in the same way.
_MAX_TOLD: Final = 3


@dataclass(frozen=True, eq=False)
class TruthCloud:
    """A truth cloud, decoded only for the sweep of its stamp.

    Attributes:
        stamp_ns: Its header stamp, integer nanoseconds.
        message: The sensor_msgs/PointCloud2.
    """

    stamp_ns: int
    message: Any

    def of(self, sweep: Sweep, findings: Findings) -> FlowTruth:
        """Returns the truth of the points of its sweep; points that are not in it are not valid.

        Raises:
            RecordingError: It is damaged, or does not fit the sweep.
        """
        truth, positions = FlowTruth.decode(self.message), _positions(self.message)
        rows, cloud = sweep.source.rows, sweep.source
        if len(truth) == cloud.num_points:
            own = truth.of_points(rows)
            if positions is None:
                return own
            unfit = own.valid & ~_is_near(positions[rows], sweep)
            if np.count_nonzero(unfit) <= _MAX_UNFIT * np.count_nonzero(own.valid):
                return _without(own, unfit, findings)
        elif positions is None:
            raise RecordingError(
                f"truth has {len(truth)} rows and no x, y, z, its sweep has {cloud.num_points} "
                "points; expected one row for each"
            )
        rows = _nearest_rows(positions, sweep)
        unfit = ~_is_near(positions[rows], sweep)
        if np.count_nonzero(unfit) > _MAX_UNFIT * len(sweep):
            raise RecordingError(
                f"{np.count_nonzero(unfit):,} of {len(sweep):,} points have another position than "
                "in their truth, in any order of its rows"
            )
        findings.count(Event.TRUTH_REORDERED)
        return _without(truth.of_points(rows), unfit, findings)


def truth_clouds(reader: BagReader, topic: str, findings: Findings) -> Iterator[TruthCloud]:
    """Yields the truth clouds of a topic in order of reception."""

    def cloud_of(message: Any, _: int) -> TruthCloud:  # noqa: ANN401 - a PointCloud2
        return TruthCloud(decode_stamp(message.header.stamp), message)

    return filter(None, _decoded(reader, topic, findings, cloud_of))


class TruthTrack:
    """Matches truth clouds to sweeps in stamp order; holds a few clouds at a time."""

    def __init__(self, clouds: Iterable[TruthCloud], findings: Findings, name: str) -> None:
        """Starts before the first of the clouds."""
        self._clouds = iter(clouds)
        self._findings = findings
        self._name = name
        self._head = next(self._clouds, None)

    def take(self, sweep: Sweep) -> tuple[FlowTruth | None, int]:
        """Returns the truth of the points of a sweep, and the number of clouds skipped before it.

        The sweep of a skipped cloud is missing. Truth that does not fit is reported, and not used.
        """
        if sweep.source.parts:
            taken = [self.take(part) for part in sweep.source.parts]
            known = [truth for truth, _ in taken if truth is not None]
            is_known = len(known) == len(taken)
            return FlowTruth.joined(known) if is_known else None, sum(n for _, n in taken)
        passed_over = 0
        while self._head is not None and self._head.stamp_ns < sweep.stamp_ns - _SAME_STAMP_NS:
            self._head = next(self._clouds, None)
            passed_over += 1
        if self._head is None or self._head.stamp_ns > sweep.stamp_ns + _SAME_STAMP_NS:
            return None, passed_over
        cloud, self._head = self._head, next(self._clouds, None)
        try:
            return cloud.of(sweep, self._findings), passed_over
        except RecordingError as error:
            if self._findings.counts[Event.TRUTH_UNFIT] < _MAX_TOLD:
                where = f"truth at stamp {cloud.stamp_ns}"
                self._findings.report(Damage(self._name, where, str(error)))
            self._findings.count(Event.TRUTH_UNFIT)
            return None, passed_over


def _positions(message: Any) -> NDArray[np.float64] | None:  # noqa: ANN401 - a PointCloud2
    """The positions (N, 3) in the rows of a truth cloud, if it has them."""
    points = decode_points(message).ravel()
    if not set("xyz") <= set(points.dtype.names or ()):
        return None
    # Flipped bits make numbers of any kind.
    with np.errstate(all="ignore"):
        return np.stack([points[axis].astype(np.float64) for axis in "xyz"], axis=1)


def _is_near(positions: NDArray[np.float64], sweep: Sweep) -> NDArray[np.bool_]:
    """Whether each of (N, 3) positions is that of the point of a sweep in the same row."""
    with np.errstate(all="ignore"):
        near = np.isclose(positions, sweep.xyz, rtol=1e-5, atol=_SAME_POINT_M)
    return np.asarray(near.all(axis=1))


def _nearest_rows(positions: NDArray[np.float64], sweep: Sweep) -> NDArray[np.int64]:
    """The row of the nearest of (M, 3) positions for each point of a sweep."""
    finite = np.flatnonzero(np.isfinite(positions).all(axis=1))
    # A tree of equal points takes the square of their number.
    distinct, first = np.unique(positions[finite], axis=0, return_index=True)
    if not len(distinct):
        raise RecordingError("no row of the truth has a finite position")
    with np.errstate(all="ignore"):
        _, nearest = cKDTree(distinct).query(sweep.xyz)
    return finite[first[nearest]]


def _without(truth: FlowTruth, unfit: NDArray[np.bool_], findings: Findings) -> FlowTruth:
    """Truth whose unfit rows (N,) are not valid; they are counted."""
    if not unfit.any():
        return truth
    findings.count(Event.TRUTH_ROWS_UNFIT, int(np.count_nonzero(unfit)))
    findings.count(Event.TRUTH_ROWS_COMPARED, len(truth))
    return replace(truth, valid=truth.valid & ~unfit)
