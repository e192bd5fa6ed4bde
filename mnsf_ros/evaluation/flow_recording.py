# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The estimated flow of a task as a recording: estimate, error and truth clouds."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from glob import escape
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_columns import FLOW_NAMES
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.recording.bag_writer import BagWriter
from msg_utils.point_cloud2 import encode_columns

# Part of the folder of a run.
FLOW_FOLDER: Final = "flow"
FLOW_TOPIC: Final = "/flow"
ERROR_TOPIC: Final = "/flow/error"
TRUTH_TOPIC: Final = "/flow/truth"

Columns = dict[str, NDArray[Any]]
Record = Callable[[Example, NDArray[np.float32]], None]


@contextmanager
def flow_recorder(folder: Path | None, recording: str, method: str) -> Iterator[Record]:
    """Opens the recording of a task's flow in a folder; it appears when all is done.

    A recording of the same task is replaced. Without a folder, nothing is written.

    Returns:
        A function that writes the flow (N, 3) of all points of an example: that of the scored ones,
        and with truth its error and the true flow.

    Raises:
        RecordingError: Something else is there, or it cannot be written.
    """
    path = flow_path(folder, recording, method)
    if path is None:
        yield lambda _example, _flow: None
        return
    # Left behind by a process that was killed while it wrote the same.
    for leftover in path.parent.glob(f".{escape(path.name)}.*.partial"):
        shutil.rmtree(leftover, ignore_errors=True)
    with BagWriter(path, overwrite=True) as writer:
        yield partial(_write, writer)


def _write(writer: BagWriter, example: Example, flow: NDArray[np.float32]) -> None:
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
        writer.write_cloud(topic, cloud, sweep.stamp_ns, sweep.frame_id, is_dense=is_dense)


def flow_path(folder: Path | None, recording: str, method: str) -> Path | None:
    """Returns the path of the recording of a task's flow; None without a folder."""
    return None if folder is None else folder / folder_name(recording, method)


def folder_name(recording: str, method: str) -> str:
    """Returns a name for the folder of a task that any file system and locale can have."""
    plain = f"{recording}.{method}"
    safe = re.sub(r"[^A-Za-z0-9_.-]+", "_", plain).strip("._")[:100]
    # Two tasks must not share a name.
    return safe if safe == plain else f"{safe}.{hashlib.sha256(plain.encode()).hexdigest()[:8]}"


def _flow_columns(flow: NDArray[np.float32]) -> Columns:
    return {name: flow[:, axis] for axis, name in enumerate(FLOW_NAMES)}
