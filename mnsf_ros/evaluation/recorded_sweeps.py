"""The sweeps of a recording, with the rows of the cloud that their points came from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.evaluation.findings import SWEEPS_READ, SWEEPS_UNSTAMPED, Findings
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.readable_messages import readable_messages
from mnsf_ros.sweeps.sweep import Sweep
from msg_utils.errors import MessageError
from msg_utils.point_cloud2 import decode_xyz
from msg_utils.stamps import decode_stamp


@dataclass(frozen=True, eq=False)
class CloudRows:
    """Where the points of a sweep were in the recorded cloud; the `source` of a recorded sweep.

    Attributes:
        rows: (N,) row of each point of the sweep, counted row by row in the cloud.
        num_points: Points of the cloud, also those that are not in the sweep.
        recording: Name of the recording.
    """

    rows: NDArray[np.int64]
    num_points: int
    recording: str = ""


def recorded_sweeps(
    reader: BagReader, topic: str, recording: str, findings: Findings
) -> Iterator[Sweep | None]:
    """Yields the sweeps of a topic as they were received.

    Args:
        reader: An open recording.
        topic: Topic of the clouds.
        recording: Name of the recording.
        findings: Gets what cannot be read.

    Yields:
        Sweeps of the finite points, whose `source` is a CloudRows; None where sweeps may be
        missing.
    """
    for item in readable_messages(reader, topic):
        if isinstance(item, Damage):
            findings.report(item)
            yield None
            continue
        received_ns, message = item
        try:
            xyz, finite = decode_xyz(message)
            stamp_ns = decode_stamp(message.header.stamp)
        except MessageError as error:
            number = findings.counts[SWEEPS_READ]
            where = f"after {number} sweeps on {topic!r}"
            findings.report(Damage(str(reader.path), where, f"damaged cloud: {error}"))
            yield None
            continue
        findings.count(SWEEPS_READ)
        findings.count(SWEEPS_UNSTAMPED, int(stamp_ns == 0))
        source = CloudRows(np.flatnonzero(finite), len(finite), recording)
        yield Sweep(xyz, stamp_ns or received_ns, message.header.frame_id, source)
