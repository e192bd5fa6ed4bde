"""What came out of a replay: its flows scored as the evaluator does, figures, and a picture."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.demo.replay import FLOW_TOPIC, ReplayLog
from mnsf_ros.drawing.top_view import save_top_view
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.options import EvaluationOptions, choose_topics
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.results import summarize
from mnsf_ros.evaluation.scoring import scored_row
from mnsf_ros.evaluation.tables import TextTable, errors_table, format_number
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.settings import Settings
from msg_utils.point_cloud2 import decode_points

_GROUND, _OTHERS = "ground", "without ground"


def score_and_draw(
    recording: Path, topic: str, flow_bag: Path, settings: Settings, picture: Path
) -> TextTable | None:
    """Scores the recorded flows against the truth, and draws the last one.

    Args:
        recording: What was replayed.
        topic: Topic of its clouds.
        flow_bag: Recording of the published flow.
        settings: What the node ran with.
        picture: File to draw.

    Returns:
        The errors; None if the recording has no truth.

    Raises:
        MnsfError: If either recording cannot be read.
        OSError: If the picture cannot be written.
    """
    # Ground is scored as well, apart from the rest.
    settings = settings.changed({"ground.remove": False})
    options = EvaluationOptions(settings)
    evaluated = choose_topics(inspect_recording(recording), recording.name, topic)
    rows: list[ResultRow] = []
    last: tuple[Example, NDArray[np.float32]] | None = None
    with evaluated.inspection.open() as reader, BagReader(flow_bag) as flows:
        for example in read_examples(reader, evaluated, options, Findings()):
            flow = _recorded_flow(flows, example)
            if flow is not None:
                rows += _scored(example, flow)
                last = example, flow
    if last is not None:
        _draw(picture, *last)
    return _errors_table(rows)


def _recorded_flow(flows: BagReader, example: Example) -> NDArray[np.float32] | None:
    """The flow (N, 3) of the points of an example; None if the node published none."""
    current = example.triplet.current
    stamp_ns = current.stamp_ns
    for message in flows.messages(FLOW_TOPIC, start_ns=stamp_ns, stop_ns=stamp_ns + 1):
        points = decode_points(message).ravel()[current.source.rows]
        columns = [points[f"flow_{axis}"].astype(np.float32) for axis in "xyz"]
        return np.stack(columns, axis=1)
    return None


def _scored(example: Example, flow: NDArray[np.float32]) -> list[ResultRow]:
    """The errors of the ground points and of all others."""
    truth = example.truth
    if truth is None:
        return []
    estimate = FlowEstimate(flow, kept=np.asarray(np.isfinite(flow).all(axis=1)))
    return [
        scored_row(replace(example, truth=replace(truth, valid=truth.valid & part)), name, estimate)
        for name, part in ((_OTHERS, ~truth.ground), (_GROUND, truth.ground))
    ]


def _errors_table(rows: list[ResultRow]) -> TextTable | None:
    if not rows:
        return None
    others, ground = (summary.errors for summary in summarize(rows, (_OTHERS, _GROUND)))
    errors: dict[str, FlowErrors] = {
        _OTHERS: others["all"],
        "- dynamic": others["dynamic"],
        "- static": others["static"],
        _GROUND: ground["all"],
    }
    title = f"Errors against the truth of the recording, mean over {len(rows) // 2} flows"
    return errors_table(errors, title=title, row_title="points")


def figures_table(log: ReplayLog) -> TextTable:
    """Returns what became of the sweeps, and the latency of their flows."""
    latencies_ms = log.latencies_ms
    rows = [
        ("sweeps in", str(len(log.published_s))),
        ("flows out", str(len(log.arrived_s))),
        ("dropped for a newer sweep", str(log.num_dropped)),
    ]
    rows += [(name, str(count)) for name, count in log.losses.items() if count]
    rows += [
        ("latency median (ms)", format_number(_percentile(latencies_ms, 50), 0)),
        ("latency p95 (ms)", format_number(_percentile(latencies_ms, 95), 0)),
    ]
    return TextTable(("figure", "value"), rows, "Replay")


def drop_hint(log: ReplayLog) -> str | None:
    """Returns what to do about dropped sweeps; None if there are none."""
    num_sweeps = log.num_dropped + len(log.arrived_s)
    if not log.num_dropped:
        return None
    cores = os.cpu_count() or 1
    return (
        f"Flow for {len(log.arrived_s)} of {num_sweeps} sweeps: this machine was too slow or busy "
        f"(load {os.getloadavg()[0]:.1f} on {cores} core{'' if cores == 1 else 's'}), so that the "
        f"node dropped {log.num_dropped} to stay up to date. Close other programs, or lower "
        "crop.max_range_m; see docs/performance.md."
    )


def _draw(path: Path, example: Example, flow: NDArray[np.float32]) -> None:
    truth, current = example.truth, example.triplet.current
    true_flow = None
    if truth is not None and truth.valid.any():
        true_flow = np.where(truth.valid[:, None], truth.flow, np.float32(np.nan))
    title = f"sweep {current.stamp_ns / 1e9:.3f} s"
    save_top_view(path, current.xyz, flow, title=title, truth=true_flow)


def _percentile(values: list[float], percentile: float) -> float:
    return float(np.percentile(values, percentile)) if values else math.nan
