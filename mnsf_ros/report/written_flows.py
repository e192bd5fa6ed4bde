"""Examples of a run with the flows that it has written, for pictures."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.drawing.example_pictures import PicturedExample, PicturedFlow
from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.flow_recording import (
    ERROR_TOPIC,
    FLOW_TOPIC,
    TRUTH_TOPIC,
    folder_name,
)
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.recording.bag_reader import BagReader
from msg_utils.point_cloud2 import decode_points


def recorded_examples(
    run_folder: Path, rows: Sequence[ResultRow], methods: Sequence[str]
) -> list[PicturedExample]:
    """Reads flows that `mnsf evaluate --write-flow` has written.

    Args:
        run_folder: Folder of the run.
        rows: The examples wanted, in this order.
        methods: Whose flows are wanted.

    Returns:
        The examples for which at least one flow was found.
    """
    examples: dict[tuple[str, int], PicturedExample] = {}
    for method in methods:
        for row in rows:
            folder = run_folder / "flow" / folder_name(row.recording, method)
            # A run that was interrupted has some of them; pictures of those are better than none.
            with suppress(MnsfError, OSError):
                _add_recorded(examples, row, method, folder)
    return [examples[row.recording, row.number] for row in rows if _key(row) in examples]


def _add_recorded(
    examples: dict[tuple[str, int], PicturedExample], row: ResultRow, method: str, folder: Path
) -> None:
    with BagReader(folder) as reader:
        clouds = {topic: _cloud(reader, topic, row.stamp_ns) for topic in reader.topics}
    cloud = clouds.get(FLOW_TOPIC)
    if cloud is None:
        return
    truth, error = clouds.get(TRUTH_TOPIC), clouds.get(ERROR_TOPIC)
    errors_m = np.full(len(cloud), np.nan) if error is None else error["error_m"].astype(float)
    example = PicturedExample(
        row.recording,
        row.number,
        row.stamp_ns,
        xyz=_columns(cloud, ("x", "y", "z")),
        truth=None if truth is None else _columns(truth, _FLOW),
    )
    example = examples.setdefault(_key(row), example)
    # Clouds of another size belong to another run, and their rows to other points.
    if len(cloud) == len(example.xyz):
        example.flows.append(PicturedFlow(method, _columns(cloud, _FLOW), errors_m))


_FLOW = ("flow_x", "flow_y", "flow_z")


def _cloud(reader: BagReader, topic: str, stamp_ns: int) -> NDArray[np.void] | None:
    messages = reader.messages(topic, start_ns=stamp_ns, stop_ns=stamp_ns + 1)
    message = next(iter(messages), None)
    return None if message is None else decode_points(message).ravel()


def _columns(points: NDArray[np.void], names: Sequence[str]) -> NDArray[np.float32]:
    return np.stack([points[name].astype(np.float32) for name in names], axis=1)


def _key(row: ResultRow) -> tuple[str, int]:
    return row.recording, row.number
