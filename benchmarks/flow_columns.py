# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the fields of the output cost: CPU of building the serialized cloud of a full sweep.

python benchmarks/flow_columns.py
"""

from __future__ import annotations

import time
from typing import Final

import numpy as np
from rich.console import Console

from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround
from mnsf_ros.recording.bag_messages import cloud_message
from mnsf_ros.report.text_table import TextTable
from mnsf_ros.settings import OutputSettings, TimeSettings
from mnsf_ros.sweeps_io.flow_cloud import flow_cloud, sweep_from_message
from msg_utils.point_cloud2 import encode_columns

_NUM_POINTS: Final = 120_000
_SHARE_DYNAMIC: Final = 0.1
_INTERVAL_S: Final = 0.1
_ROUNDS: Final = 60
_LAYOUTS: Final = {
    "full": OutputSettings(),
    "full without rgb": OutputSettings(rgb=False),
    "compact": OutputSettings(layout="compact"),
}


def main() -> None:
    """Prints the table; layouts take turns, so that the load of the machine is that of all."""
    random = np.random.default_rng(0)
    xyz = random.normal(scale=20, size=(_NUM_POINTS, 3)).astype(np.float32)
    names = {name: np.ascontiguousarray(xyz[:, axis]) for axis, name in enumerate("xyz")}
    columns = {**names, "intensity": np.zeros(_NUM_POINTS, np.float32)}
    cloud = cloud_message(encode_columns(columns, 1, _NUM_POINTS), 10**9, "lidar", is_dense=True)
    sweep = sweep_from_message(cloud, TimeSettings(), 0)
    dynamic = random.random(_NUM_POINTS) < _SHARE_DYNAMIC
    motion = np.where(dynamic[:, None], random.normal(scale=0.5, size=xyz.shape), 0)
    motion = motion.astype(np.float32)
    confidence = np.ones(_NUM_POINTS, np.float32)
    over_ground = OverGround(motion, dynamic, confidence, np.eye(4), np.eye(4), "registration")
    estimate = FlowEstimate(motion + 1, np.ones(_NUM_POINTS, bool), over_ground=over_ground)
    times_ms: dict[str, list[float]] = {name: [] for name in _LAYOUTS}
    sizes = {}
    for _ in range(_ROUNDS):
        for name, layout in _LAYOUTS.items():
            start_s = time.process_time()
            sizes[name] = len(flow_cloud(sweep, estimate, _INTERVAL_S, layout))
            times_ms[name].append(1e3 * (time.process_time() - start_s))
    rows = [
        (name, f"{sizes[name] / _NUM_POINTS:.0f}", f"{np.median(values):.1f}")
        for name, values in times_ms.items()
    ]
    title = f"Clouds with flow, {_NUM_POINTS:,} points, input with x, y, z, intensity"
    Console().print(TextTable(("layout", "bytes a point", "CPU (ms, median)"), rows, title))


if __name__ == "__main__":
    main()
