"""Writing a simulated recording with its truth."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.conventions import (
    LIDAR_FRAME,
    ODOMETRY_FRAME,
    POINTS_TOPIC,
    TRUTH_FLOW_TOPIC,
    TRUTH_ODOMETRY_TOPIC,
)
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.simulation.sweeps import simulate_sweeps
from msg_utils.point_cloud2 import encode_columns

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from mnsf_ros.simulation.settings import SimulationSettings
    from mnsf_ros.simulation.sweeps import SimulatedSweep


def write_recording(
    settings: SimulationSettings,
    path: Path | str,
    progress: Callable[[int, int], None] | None = None,
    *,
    overwrite: bool = False,
    compress: bool = False,
) -> None:
    """Simulate a recording and write it as a rosbag2 folder.

    Args:
        settings: What to simulate.
        path: Folder to write; it appears when all is done.
        progress: Called after every sweep with the number of sweeps done and to do.
        overwrite: Whether a recording at the same path may be replaced.
        compress: Whether to compress the file: smaller but slower to write and read.

    Raises:
        RecordingError: The recording cannot be written.
    """
    with BagWriter(path, overwrite=overwrite, compress=compress) as writer:
        for index, sweep in enumerate(simulate_sweeps(settings)):
            _write_sweep(writer, sweep, is_last=index + 1 == settings.num_sweeps)
            if progress is not None:
                progress(index + 1, settings.num_sweeps)


def _write_sweep(writer: BagWriter, sweep: SimulatedSweep, *, is_last: bool) -> None:
    num_points = len(sweep.xyz)
    columns = {name: sweep.xyz[:, axis] for axis, name in enumerate("xyz")}
    points = encode_columns(
        {**columns, "intensity": sweep.intensity, "ring": sweep.ring}, 1, num_points
    )
    truth = FlowTruth(
        stamp_ns=sweep.stamp_ns,
        flow=sweep.flow,
        # The last sweep has no next sweep in which its points could be found.
        valid=np.full(num_points, not is_last),
        dynamic=sweep.dynamic,
        ground=sweep.ground,
        class_id=sweep.class_id,
    )
    stamp_ns = sweep.stamp_ns
    writer.write_cloud(POINTS_TOPIC, points, stamp_ns, LIDAR_FRAME)
    writer.write_cloud(
        TRUTH_FLOW_TOPIC, truth.encode(sweep.xyz), stamp_ns, LIDAR_FRAME, is_dense=not is_last
    )
    writer.write_odometry(
        TRUTH_ODOMETRY_TOPIC, sweep.world_from_sensor, stamp_ns, ODOMETRY_FRAME, LIDAR_FRAME
    )
