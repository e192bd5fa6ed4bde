# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Writing a simulated recording with its truth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.recording.bag_topics import LIDAR_FRAME
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator


def write_recording(
    settings: SimulationSettings,
    path: Path | str,
    progress: Callable[[int, int], None] | None = None,
    *,
    overwrite: bool = False,
    compress: bool = False,
) -> SweepSimulator:
    """Simulates a recording, writes it with a BagWriter and returns its simulator.

    After every sweep `progress` is called with the number of sweeps done and to do.

    Raises:
        RecordingError: The recording cannot be written.
    """
    simulator = SweepSimulator(settings)
    with BagWriter(path, overwrite=overwrite, compress=compress) as writer:
        for index in range(simulator.num_sweeps):
            sweep = simulator.sweep(index)
            columns: dict[str, NDArray[Any]] = {"intensity": sweep.intensity, "ring": sweep.ring}
            if sweep.times_ns is not None:
                columns["t"] = sweep.times_ns
            # The last sweep has no next sweep in which its points could be found.
            valid = sweep.valid & (index + 1 < simulator.num_sweeps)
            truth = FlowTruth(
                sweep.stamp_ns,
                sweep.flow,
                valid,
                sweep.dynamic,
                sweep.ground,
                sweep.class_id,
                # Ground and drops of rain, body -1, are no object.
                (sweep.body + 1).astype(np.uint32),
            )
            writer.write_sweep(sweep.xyz, columns, truth, sweep.world_from_sensor, LIDAR_FRAME)
            if progress is not None:
                progress(index + 1, simulator.num_sweeps)
    return simulator
