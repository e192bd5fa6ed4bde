"""What came out of a replay: a table of figures, a table of errors, and a picture."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.demo.replay import FLOW_TOPIC, ReplayLog
from mnsf_ros.drawing.top_view import save_top_view
from mnsf_ros.evaluation.metrics import FlowErrors, by_motion, flow_errors, mean_of
from mnsf_ros.evaluation.tables import TextTable, errors_table, format_number
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.conventions import TRUTH_FLOW_TOPIC
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.recording.truth import FlowTruthIndex, read_truth
from msg_utils.point_cloud2 import decode_points
from msg_utils.stamps import decode_stamp


@dataclass(frozen=True, eq=False)
class RecordedFlow:
    """One flow cloud of a recording, with its truth where there is one.

    Attributes:
        stamp_ns: Stamp of the sweep.
        xyz: (N, 3) all points of the cloud, metres, NaN where there is none.
        flow: (N, 3) metres until the next sweep, NaN where the point has none.
        truth: True flow of the same points, or None.
    """

    stamp_ns: int
    xyz: NDArray[np.float32]
    flow: NDArray[np.float32]
    truth: FlowTruth | None


def read_flows(flow_bag: Path, recording: BagReader) -> Iterator[RecordedFlow]:
    """Reads what was recorded, one cloud at a time.

    Args:
        flow_bag: Recording of the published flow.
        recording: The open recording that was replayed.

    Raises:
        RecordingError: If either cannot be read, or the truth does not fit the clouds.
    """
    truth = read_truth(recording) if TRUTH_FLOW_TOPIC in recording.topics else None
    with BagReader(flow_bag) as reader:
        for message in reader.messages(FLOW_TOPIC):
            points = decode_points(message).ravel()
            stamp_ns = decode_stamp(message.header.stamp)
            yield RecordedFlow(
                stamp_ns=stamp_ns,
                xyz=_columns(points, "xyz"),
                flow=_columns(points, ("flow_x", "flow_y", "flow_z")),
                truth=_truth_of(truth, stamp_ns, len(points)),
            )


class FlowScore:
    """Errors of flows that come one at a time, and the last of them for a picture."""

    def __init__(self) -> None:
        self.last: RecordedFlow | None = None
        self._examples: dict[str, list[FlowErrors]] = {}

    def add(self, item: RecordedFlow) -> None:
        """Takes one more flow."""
        self.last = item
        if item.truth is None:
            return
        scored = item.truth.valid & np.isfinite(item.flow).all(axis=1)
        ground = item.truth.ground
        errors = by_motion(item.flow, item.truth.flow, item.truth.dynamic, scored & ~ground)
        errors["ground"] = flow_errors(item.flow, item.truth.flow, scored & ground)
        for name, value in errors.items():
            self._examples.setdefault(_ROW_NAMES[name], []).append(value)

    def table(self) -> TextTable | None:
        """Each value the mean over the sweeps; None if there was no truth."""
        if not self._examples:
            return None
        num_sweeps = max(len(values) for values in self._examples.values())
        return errors_table(
            {name: mean_of(values) for name, values in self._examples.items()},
            title=f"Errors against the recording's truth, mean over {num_sweeps} flows",
            row_title="points",
        )


_ROW_NAMES = {
    "all": "without ground",
    "dynamic": "- moving",
    "static": "- standing",
    "ground": "ground",
}


def figures_table(log: ReplayLog) -> TextTable:
    """Sweeps, flows, drops and latency of a replay."""
    latencies_ms = log.latencies_ms
    dropped = log.node_values.get("triplets_dropped", "0")
    rows = [
        ("sweeps in", str(len(log.published_s))),
        ("flows out", str(len(log.arrived_s))),
        ("triplets dropped for a newer one", dropped),
        ("latency median (ms)", format_number(_percentile(latencies_ms, 50), 0)),
        ("latency p95 (ms)", format_number(_percentile(latencies_ms, 95), 0)),
    ]
    return TextTable(("figure", "value"), rows, "Replay")


def save_picture(path: Path, item: RecordedFlow) -> None:
    """Draws a flow from above, over its truth where there is one."""
    has_truth = item.truth is not None and item.truth.valid.any()
    save_top_view(
        path,
        item.xyz,
        item.flow,
        title=f"sweep {item.stamp_ns / 1e9:.3f} s",
        truth=item.truth.flow if item.truth is not None and has_truth else None,
    )


def _truth_of(truth: FlowTruthIndex | None, stamp_ns: int, num_points: int) -> FlowTruth | None:
    if truth is None or stamp_ns not in truth:
        return None
    return truth.of_sweep(stamp_ns, num_points)


def _columns(points: NDArray[np.void], names: str | tuple[str, ...]) -> NDArray[np.float32]:
    return np.stack([points[name].astype(np.float32) for name in names], axis=1)


def _percentile(values: list[float], percentile: float) -> float:
    return float(np.percentile(values, percentile)) if values else math.nan
