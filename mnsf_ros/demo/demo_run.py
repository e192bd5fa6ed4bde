# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The demo: a recording goes through the live node; its flow is recorded, scored and drawn."""

from __future__ import annotations

import os
import secrets
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from rich.console import Console

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.demo.console_progress import counting_progress, simulate_with_progress
from mnsf_ros.demo.node_process import node_process
from mnsf_ros.demo.replay import DIAGNOSTICS_TOPIC, FLOW_TOPIC, ReplayLog, replay
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.pictures import sweep_picture
from mnsf_ros.evaluation.recordings import EvaluatedRecording, choose_topics
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.scoring import scored_row
from mnsf_ros.evaluation.summary import errors_in, summarize
from mnsf_ros.node.environment import prepare_environment
from mnsf_ros.online.watches import busy_text
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.report.tables import errors_table
from mnsf_ros.report.text_table import TextTable
from mnsf_ros.settings import Settings
from mnsf_ros.settings_documents import settings_yaml
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.sweeps_io.flow_columns import FLOW_NAMES
from msg_utils.point_cloud2 import decode_points
from msg_utils.stamps import decode_stamp

_GROUND, _OTHERS = "ground", "without ground"
_NUM_DOMAINS: Final = 101  # from 1 on; above, ports of Linux are used for something else
_ENOUGH: Final = 0.95  # share of the possible flows


def run_demo(
    source: Path | SimulationSettings,
    topic: str | None,
    settings: Settings,
    folder: Path,
    console: Console,
) -> None:
    """Runs the demo with a recording, or with a simulated one, and prints its tables.

    `topic` is that of the clouds, None for the only one; everything is written into `folder`.

    Raises:
        MnsfError: If the recording cannot be read, or the node gives no flow; one line.
    """
    path = _street(source, folder, console) if isinstance(source, SimulationSettings) else source
    recording = choose_topics(path, path.name, topic)
    folder.mkdir(parents=True, exist_ok=True)
    flow_bag, picture = folder / "flow", folder / "flow.png"
    log = _replayed(recording, flow_bag, settings, folder, console)
    console.print("scoring and drawing the flow")
    errors = _score_and_draw(recording, flow_bag, settings, picture)
    if errors is not None:
        console.print(errors)
    console.print(f"picture   {picture}")
    console.print(f"flow      {flow_bag} (mcap: opens coloured in Foxglove; or `mnsf play`)")
    console.print(verdict(log), markup=False, highlight=False, soft_wrap=True)


def _street(settings: SimulationSettings, folder: Path, console: Console) -> Path:
    """The simulated street of a folder; it is simulated once."""
    folder.mkdir(parents=True, exist_ok=True)
    street = folder / f"street_seed{settings.seed}_{settings.duration_s:g}s"
    if not street.exists():
        simulate_with_progress(settings, street, console)
    return street


def _replayed(
    recording: EvaluatedRecording,
    flow_bag: Path,
    settings: Settings,
    folder: Path,
    console: Console,
) -> ReplayLog:
    prepare_environment()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    # Separate from robots and from other demos.
    domain, namespace = 1 + secrets.randbelow(_NUM_DOMAINS), f"/mnsf_demo_{secrets.token_hex(4)}"
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    parameter_file = folder / "parameters.yaml"
    parameter_file.write_text(settings_yaml(settings, "Settings of the demo."))
    topic, path = recording.points, recording.path
    live = f"live on ROS domain {domain}, {namespace}{FLOW_TOPIC}"
    console.print(f"replaying {topic} of {path}; {live}", soft_wrap=True)
    remappings = (f"__ns:={namespace}", f"{DIAGNOSTICS_TOPIC}:={namespace}{DIAGNOSTICS_TOPIC}")
    arguments = ["--params-file", str(parameter_file)]
    arguments += [word for remapping in remappings for word in ("-r", remapping)]
    with (
        recording.open() as reader,
        node_process(arguments, folder / "node.log") as node,
        BagWriter(flow_bag, overwrite=True) as writer,
        counting_progress(console) as progress,
    ):
        task = progress.add_task("starting the node", total=recording.num_sweeps)

        def show(num_sweeps: int, num_flows: int) -> None:
            text = f"{num_flows} flows out; sweeps in:"
            progress.update(task, completed=num_sweeps, description=text)

        log = replay(reader, topic, node, writer, show, namespace)
        if not log.arrived_s:
            raise node.failure(
                f"no flow came out of {len(log.published_s)} sweeps "
                f"(last failure: {log.values.get('last failure', 'unknown')})"
            )
    return log


def _score_and_draw(
    recording: EvaluatedRecording, flow_bag: Path, settings: Settings, picture: Path
) -> TextTable | None:
    """Scores the recorded flows as the evaluator does; draws the last one. None without truth."""
    # Ground is scored as well, apart from the rest.
    options = EvaluationOptions(settings.changed({"ground.remove": False}))
    rows: list[ResultRow] = []
    last: tuple[Example, FlowEstimate] | None = None
    with recording.open() as reader, BagReader(flow_bag) as flows:
        for example in read_examples(reader, recording, options, Findings()):
            flow = _recorded_flow(flows, example)
            if flow is not None:
                estimate = FlowEstimate(flow, kept=np.asarray(np.isfinite(flow).all(axis=1)))
                rows += _scored(example, estimate)
                last = example, estimate
    if last is not None:
        picture.write_bytes(sweep_picture(*last))
    return _errors_table(rows)


def _recorded_flow(flows: BagReader, example: Example) -> NDArray[np.float32] | None:
    """The flow (N, 3) of the points of an example; None if the node published none."""
    current = example.triplet.current
    stamp_ns = current.stamp_ns
    message = next(flows.since(stamp_ns).messages(FLOW_TOPIC), None)
    if message is None or decode_stamp(message.header.stamp) != stamp_ns:
        return None
    points = decode_points(message).ravel()[current.source.rows]
    return np.stack([points[name].astype(np.float32) for name in FLOW_NAMES], axis=1)


def _scored(example: Example, estimate: FlowEstimate) -> list[ResultRow]:
    truth = example.truth
    if truth is None:
        return []
    return [
        scored_row(replace(example, truth=replace(truth, valid=truth.valid & part)), name, estimate)
        for name, part in ((_OTHERS, ~truth.ground), (_GROUND, truth.ground))
    ]


def _errors_table(rows: list[ResultRow]) -> TextTable | None:
    if not rows:
        return None
    summary = summarize(rows, (_OTHERS, _GROUND))
    errors = {
        _OTHERS: errors_in(summary, "all").loc[_OTHERS],
        "- dynamic": errors_in(summary, "dynamic").loc[_OTHERS],
        "- static": errors_in(summary, "static").loc[_OTHERS],
        _GROUND: errors_in(summary, "all").loc[_GROUND],
    }
    title = f"Errors against the truth of the recording, mean over {len(rows) // 2} flows"
    return errors_table(pd.DataFrame(errors).T, title, "points")


def verdict(log: ReplayLog) -> str:
    """Returns one line: number and latency of the flows, and why some are missing."""
    flows = f"{len(log.arrived_s)} of {log.num_possible} flows"
    if log.latencies_ms:
        flows += f", p95 {np.percentile(log.latencies_ms, 95):.0f} ms"
    if len(log.arrived_s) >= _ENOUGH * log.num_possible:
        return f"{flows}: keeps up"
    if log.num_dropped:
        num_flows, num_possible = len(log.arrived_s), log.num_possible
        return busy_text(num_flows, num_possible, log.estimate_ms, log.interval_ms)
    others = [f"{count} {name}" for name, count in log.losses.items() if count > 0]
    return f"{flows}: {', '.join(others) or 'no reason on /diagnostics'}"
