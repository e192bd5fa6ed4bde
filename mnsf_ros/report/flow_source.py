"""Where pictures take flows from: the recordings of a run, or a second estimate of the same."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.evaluation_options import (
    ALL_POINTS,
    EvaluatedRecording,
    EvaluationOptions,
    choose_topics,
)
from mnsf_ros.evaluation.example import Example
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.flow_recording import (
    ERROR_TOPIC,
    FLOW_TOPIC,
    TRUTH_TOPIC,
    folder_name,
)
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.tasks import make_estimator, read_examples
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.report.pictured import PicturedExample, PicturedFlow
from mnsf_ros.settings import Settings
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


def estimated_examples(
    run: Mapping[str, Any], rows: Sequence[ResultRow], methods: Sequence[str]
) -> list[PicturedExample]:
    """Estimates examples once more, which gives the same flow if nothing was carried over.

    Args:
        run: The record of the run.
        rows: The examples wanted, in this order.
        methods: With which methods; those that fail on an example are left out of it.

    Raises:
        MnsfError: A recording cannot be read any more.
    """
    options = options_of(run)
    estimators = {method: make_estimator(method, options.method_settings) for method in methods}
    found: dict[tuple[str, int], PicturedExample] = {}
    for recording in _recordings_of(run, {row.recording for row in rows}):
        wanted = {row.number for row in rows if row.recording == recording.name}
        for example in _examples(recording, options, wanted):
            pictured = _pictured(example)
            for method, estimator in estimators.items():
                with suppress(MnsfError):
                    flow = estimator.estimate(example.triplet).flow
                    pictured.flows.append(PicturedFlow(method, flow, _errors(example, flow)))
            found[pictured.key] = pictured
    return [found[_key(row)] for row in rows if _key(row) in found]


def options_of(run: Mapping[str, Any]) -> EvaluationOptions:
    """Returns the options that a run had, from its record."""
    identity = run["identity"]
    number = identity["num_points"]
    return EvaluationOptions(
        settings=Settings().changed({**identity["settings"], **identity["crop_and_ground"]}),
        num_points=None if number == ALL_POINTS else number,
        seed=identity["seed"],
        use_true_ground=identity["ground"] == "truth",
        realtime_rate=identity["realtime_rate"],
        num_sweeps=identity["num_sweeps"],
    )


def _recordings_of(run: Mapping[str, Any], names: set[str]) -> Iterable[EvaluatedRecording]:
    for record in run["recordings"]:
        if record["name"] in names:
            inspection = inspect_recording(record["path"])
            topics = (record["points"], record["truth"], record["odometry"])
            yield choose_topics(inspection, record["name"], *topics)


def _examples(
    recording: EvaluatedRecording, options: EvaluationOptions, wanted: set[int]
) -> Iterable[Example]:
    left = set(wanted)
    with recording.inspection.open() as reader:
        for example in read_examples(reader, recording, options, Findings()):
            if example.number in left:
                yield example
                left.discard(example.number)
            if not left:
                return


def _pictured(example: Example) -> PicturedExample:
    truth = example.truth
    return PicturedExample(
        recording=example.recording,
        number=example.number,
        stamp_ns=example.triplet.current.stamp_ns,
        xyz=example.triplet.current.xyz,
        truth=None if truth is None else _where_valid(truth.flow, truth.valid),
        next_from_current=example.next_from_current,
        error_name="distance to next sweep" if truth is None else "end point error",
    )


def _errors(example: Example, flow: NDArray[np.float32]) -> NDArray[np.float64]:
    truth = example.truth
    if truth is not None:
        return end_point_errors(flow, _where_valid(truth.flow, truth.valid))
    distances, _ = cKDTree(example.triplet.next.xyz).query(example.triplet.current.xyz + flow)
    return np.asarray(distances, dtype=np.float64)


def _where_valid(flow: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    known: NDArray[np.float32] = np.where(valid[:, None], flow, np.float32(np.nan))
    return known


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
