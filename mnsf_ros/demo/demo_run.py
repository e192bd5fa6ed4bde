"""The demo: a recording goes through the live node, and what came out is shown."""

from __future__ import annotations

import os
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from mnsf_ros.demo.console_progress import counting_progress, simulate_with_progress
from mnsf_ros.demo.node_process import NodeProcess, node_process
from mnsf_ros.demo.replay import ReplayLog, replay
from mnsf_ros.demo.report import FlowScore, figures_table, read_flows, save_picture
from mnsf_ros.node.process_environment import prepare_environment
from mnsf_ros.presets import preset
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.points_topic import find_points_topic
from mnsf_ros.settings_documents import settings_yaml
from mnsf_ros.simulation.settings import SimulationSettings


@dataclass(frozen=True)
class DemoOptions:
    """What to show.

    Attributes:
        bag: Recording to replay; None for a simulated one.
        topic: Topic of its clouds; None for the only one.
        preset: Name of the preset that the node runs with.
        simulation: The recording to simulate if there is no bag.
        folder: Where everything is written.
    """

    bag: Path | None
    topic: str | None
    preset: str
    simulation: SimulationSettings
    folder: Path


def run_demo(options: DemoOptions, console: Console) -> None:
    """Runs the demo and prints its tables.

    Raises:
        MnsfError: If the recording cannot be read or the node gives no flow; one line.
    """
    bag = options.bag or _simulated(options, console)
    with BagReader(bag) as recording:
        topic = find_points_topic(recording, options.topic)
        options.folder.mkdir(parents=True, exist_ok=True)
        log = _replayed(recording, topic, options, console)
        score = FlowScore()
        for item in read_flows(_flow_bag(options), recording):
            score.add(item)
    _show(log, score, options, console)


def _flow_bag(options: DemoOptions) -> Path:
    return options.folder / "flow"


def _simulated(options: DemoOptions, console: Console) -> Path:
    settings = options.simulation
    path = options.folder / f"street_seed{settings.seed}_{settings.duration_s:g}s"
    if not path.exists():
        simulate_with_progress(settings, path, console)
    return path


def _replayed(
    recording: BagReader, topic: str, options: DemoOptions, console: Console
) -> ReplayLog:
    prepare_environment()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    folder = options.folder
    parameter_file = folder / "parameters.yaml"
    parameter_file.write_text(settings_yaml(preset(options.preset), f"Preset {options.preset}."))
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    console.print(f"replaying {topic} of {recording.path}; live on ROS domain {domain}")
    with ExitStack() as stack:
        node = stack.enter_context(
            node_process(["--params-file", str(parameter_file)], folder / "node.log")
        )
        writer = stack.enter_context(BagWriter(_flow_bag(options), overwrite=True))
        progress = stack.enter_context(counting_progress(console))
        task = progress.add_task("starting the node", total=recording.topics[topic].count)

        def show(num_sweeps: int, num_flows: int) -> None:
            text = f"sweeps in, {num_flows} flows out"
            progress.update(task, completed=num_sweeps, description=text)

        log = replay(recording, topic, node, writer, show)
        _require_flow(log, node)
    return log


def _require_flow(log: ReplayLog, node: NodeProcess) -> None:
    if not log.arrived_s:
        failure = log.node_values.get("last failure", "unknown")
        raise node.failure(
            f"no flow came out of {len(log.published_s)} sweeps (last failure: {failure})"
        )


def _show(log: ReplayLog, score: FlowScore, options: DemoOptions, console: Console) -> None:
    console.print(figures_table(log).rich())
    errors = score.table()
    if errors is not None:
        console.print(errors.rich())
    if score.last is not None:
        picture = options.folder / "flow.png"
        save_picture(picture, score.last)
        console.print(f"picture   {picture}")
    console.print(f"flow      {_flow_bag(options)} (mcap, for Foxglove or `ros2 bag play`)")
