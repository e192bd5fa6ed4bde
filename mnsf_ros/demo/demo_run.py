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
from mnsf_ros.demo.scores import drop_hint, figures_table, score_and_draw
from mnsf_ros.node.main import prepare_environment
from mnsf_ros.presets import preset
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import used_topics
from mnsf_ros.recording.bag_writer import BagWriter
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
        topic = used_topics(recording.path, recording.topics, options.topic).points
        options.folder.mkdir(parents=True, exist_ok=True)
        log = _replayed(recording, topic, options, console)
    console.print(figures_table(log).rich())
    hint = drop_hint(log)
    if hint is not None:
        console.print(hint, style="yellow", markup=False, highlight=False)
    picture = options.folder / "flow.png"
    errors = score_and_draw(bag, topic, _flow_bag(options), preset(options.preset), picture)
    if errors is not None:
        console.print(errors.rich())
    console.print(f"picture   {picture}")
    console.print(f"flow      {_flow_bag(options)} (mcap, for Foxglove or `ros2 bag play`)")


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
        raise node.failure(
            f"no flow came out of {len(log.published_s)} sweeps (last failure: {log.last_failure})"
        )
