# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""True flow of a recording, matched to its sweeps by stamp and by the positions of points."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from scipy.spatial import cKDTree

from mnsf_ros.arrays import Bools, Floats, Ints
from mnsf_ros.errors import RecordingError
from mnsf_ros.evaluation.findings import Event, Findings
from mnsf_ros.evaluation.tracks import decoded
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.recording.storage_file import Damage
from mnsf_ros.sweeps.sweep import Sweep
from msg_utils.point_cloud2 import decode_points
from msg_utils.stamps import decode_stamp

# Above the rounding of stamps as floating point numbers, below the interval of any lidar.
_SAME_STAMP_NS: Final = 500_000
_SAME_POINT_M: Final = 1e-3
# A lossy codec changes less, the truth of another sweep differs nearly everywhere.
_MAX_UNFIT: Final = 0.1
# All truth of a recording may be unfit in the same way.
_MAX_REPORTED: Final = 3


@dataclass(frozen=True, eq=False)
class TruthCloud:
    """A truth cloud, decoded only for the sweep of its stamp."""

    stamp_ns: int  # of its header
    message: Any  # a sensor_msgs/PointCloud2

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
    """Yields the truth clouds of a topic in stamp order."""

    def cloud_of(message: Any, _: int) -> TruthCloud:  # noqa: ANN401 - a PointCloud2
        return TruthCloud(decode_stamp(message.header.stamp), message)

    return filter(None, decoded(reader, topic, findings, cloud_of))


class TruthTrack:
    """Matches truth clouds to sweeps, both in stamp order; holds one cloud at a time."""

    def __init__(self, clouds: Iterable[TruthCloud], findings: Findings, name: str) -> None:
        """Begins before the first cloud; damage is reported under the name."""
        self._clouds = iter(clouds)
        self._findings = findings
        self._name = name
        self._head = next(self._clouds, None)

    def take(self, sweep: Sweep) -> tuple[FlowTruth | None, int]:
        """Returns the truth of the points of a sweep, and the number of clouds without a sweep.

        Truth that does not fit its sweep is reported, and not used.
        """
        if sweep.source.parts:
            taken = [self.take(part) for part in sweep.source.parts]
            known = [truth for truth, _ in taken if truth is not None]
            is_known = len(known) == len(taken)
            return FlowTruth.joined(known) if is_known else None, sum(n for _, n in taken)
        num_skipped = 0
        while self._head is not None and self._head.stamp_ns < sweep.stamp_ns - _SAME_STAMP_NS:
            self._head = next(self._clouds, None)
            num_skipped += 1
        if self._head is None or self._head.stamp_ns > sweep.stamp_ns + _SAME_STAMP_NS:
            return None, num_skipped
        cloud, self._head = self._head, next(self._clouds, None)
        try:
            return cloud.of(sweep, self._findings), num_skipped
        except RecordingError as error:
            if self._findings.counts[Event.TRUTH_UNFIT] < _MAX_REPORTED:
                where = f"truth at stamp {cloud.stamp_ns}"
                self._findings.report(Damage(self._name, where, str(error)))
            self._findings.count(Event.TRUTH_UNFIT)
            return None, num_skipped


def _positions(message: Any) -> Floats | None:  # noqa: ANN401 - a PointCloud2
    """Positions (N, 3) in the rows of a truth cloud, if it has them."""
    points = decode_points(message).ravel()
    if not set("xyz") <= set(points.dtype.names or ()):
        return None
    # Flipped bits make numbers of any kind.
    with np.errstate(all="ignore"):
        return np.stack([points[axis].astype(np.float64) for axis in "xyz"], axis=1)


def _is_near(positions: Floats, sweep: Sweep) -> Bools:
    """Whether each position (N, 3) equals the point in the same row of a sweep."""
    with np.errstate(all="ignore"):
        near = np.isclose(positions, sweep.xyz, rtol=1e-5, atol=_SAME_POINT_M)
    return np.asarray(near.all(axis=1))


def _nearest_rows(positions: Floats, sweep: Sweep) -> Ints:
    """Row of the nearest position (M, 3) for each point of a sweep."""
    finite = np.flatnonzero(np.isfinite(positions).all(axis=1))
    # A tree of equal points takes the square of their number.
    distinct, first = np.unique(positions[finite], axis=0, return_index=True)
    if not len(distinct):
        raise RecordingError("no row of the truth has a finite position")
    with np.errstate(all="ignore"):
        _, nearest = cKDTree(distinct).query(sweep.xyz)
    return finite[first[nearest]]


def _without(truth: FlowTruth, unfit: Bools, findings: Findings) -> FlowTruth:
    """Counts unfit rows (N,), and marks them as not valid."""
    if not unfit.any():
        return truth
    findings.count(Event.TRUTH_ROWS_UNFIT, int(np.count_nonzero(unfit)))
    findings.count(Event.TRUTH_ROWS_COMPARED, len(truth))
    return replace(truth, valid=truth.valid & ~unfit)
