# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The estimated flow of a task as a recording: estimate, error and truth clouds."""

from __future__ import annotations

import hashlib
import re
import shutil
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_columns import FLOW_NAMES
from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_writer import BagWriter
from msg_utils.point_cloud2 import decode_points, encode_columns

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from mnsf_ros.evaluation.examples import Example

FLOW_TOPIC: Final = "/flow"
ERROR_TOPIC: Final = "/flow/error"
TRUTH_TOPIC: Final = "/flow/truth"

Columns = dict[str, NDArray[Any]]


class FlowRecorder:
    """Writes clouds into a recording; without a writer, nowhere."""

    def __init__(self, writer: BagWriter | None) -> None:
        self._writer = writer

    def write(self, example: Example, flow: NDArray[np.float32]) -> None:
        """Writes the flow of the scored points, and with truth its error and the true flow.

        `flow` is (N, 3) metres until the next sweep, for all points of the current sweep.

        Raises:
            RecordingError: Writing fails.
        """
        if self._writer is None:
            return
        rows = np.flatnonzero(example.scored)
        xyz, flow = example.triplet.current.xyz[rows], flow[rows]
        points: Columns = {name: xyz[:, axis] for axis, name in enumerate("xyz")}
        clouds = {FLOW_TOPIC: _flow_columns(flow)}
        if example.truth is not None:
            truth = example.truth.of_points(rows)
            true_flow = np.where(truth.valid[:, None], truth.flow, np.float32(np.nan))
            error_m = end_point_errors(flow, true_flow).astype(np.float32)
            dynamic = truth.dynamic.astype(np.uint8)
            clouds[ERROR_TOPIC] = {"error_m": error_m, "dynamic": dynamic}
            clouds[TRUTH_TOPIC] = {**_flow_columns(true_flow), "dynamic": dynamic}
        sweep = example.triplet.current
        for topic, values in clouds.items():
            columns = {**points, **values}
            is_dense = all(bool(np.isfinite(column).all()) for column in columns.values())
            cloud = encode_columns(columns, 1, len(rows))
            stamp = (sweep.stamp_ns, sweep.frame_id)
            self._writer.write_cloud(topic, cloud, *stamp, is_dense=is_dense)


@contextmanager
def flow_recorder(folder: Path | None, recording: str, method: str) -> Iterator[FlowRecorder]:
    """Opens the recording of a task's flow in a folder; it appears when all is done.

    A recording of the same task is replaced. Without a folder, nothing is written.

    Raises:
        RecordingError: Something else is there, or it cannot be written.
    """
    path = flow_path(folder, recording, method)
    if path is None:
        yield FlowRecorder(None)
        return
    # Left behind by a process that was killed while it wrote the same.
    for leftover in path.parent.glob(f".{escape(path.name)}.*.partial"):
        shutil.rmtree(leftover, ignore_errors=True)
    with BagWriter(path, overwrite=True) as writer:
        yield FlowRecorder(writer)


class RecordedFlow(NamedTuple):
    """The flow of the N scored points of a sweep, see `ShownFlow`."""

    xyz: NDArray[np.float32]
    flow: NDArray[np.float32]
    error_m: NDArray[np.float32]
    truth: NDArray[np.float32] | None


def recorded_flow(path: Path, stamp_ns: int) -> RecordedFlow | None:
    """Reads the flow of a sweep; None if it is missing or unreadable."""
    with suppress(MnsfError, OSError), BagReader(path) as reader:
        clouds = {topic: _cloud(reader, topic, stamp_ns) for topic in reader.topics}
        cloud, error, truth = (clouds.get(one) for one in (FLOW_TOPIC, ERROR_TOPIC, TRUTH_TOPIC))
        if cloud is not None:
            return RecordedFlow(
                xyz=_columns(cloud, "xyz"),
                flow=_columns(cloud, FLOW_NAMES),
                error_m=(
                    np.full(len(cloud), np.nan, np.float32) if error is None else error["error_m"]
                ),
                truth=None if truth is None else _columns(truth, FLOW_NAMES),
            )
    return None


def _cloud(reader: BagReader, topic: str, stamp_ns: int) -> NDArray[np.void] | None:
    messages = reader.messages(topic, start_ns=stamp_ns, stop_ns=stamp_ns + 1)
    message = next(iter(messages), None)
    return None if message is None else decode_points(message).ravel()


def _columns(points: NDArray[np.void], names: Iterable[str]) -> NDArray[np.float32]:
    return np.stack([points[name].astype(np.float32) for name in names], axis=1)


def flow_path(folder: Path | None, recording: str, method: str) -> Path | None:
    """Returns the path of the recording of a task's flow; None without a folder."""
    return None if folder is None else folder / folder_name(recording, method)


def folder_name(recording: str, method: str) -> str:
    """Returns a name for the folder of a task that any file system can have."""
    plain = f"{recording}.{method}"
    safe = re.sub(r"[^\w.-]+", "_", plain).strip("._")[:100]
    # Two tasks must not share a name.
    return safe if safe == plain else f"{safe}.{hashlib.sha256(plain.encode()).hexdigest()[:8]}"


def _flow_columns(flow: NDArray[np.float32]) -> Columns:
    return {name: flow[:, axis] for axis, name in enumerate(FLOW_NAMES)}
