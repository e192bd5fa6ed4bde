"""Promises of the running node for `reliability.py`: soak, overload, clouds, parameters."""

from __future__ import annotations

import argparse
import itertools
import math
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

import numpy as np
import rclpy
from hostile_clouds import KINDS, hostile
from online_live import serialized, with_stamp
from online_recordings import INTERVAL_NS, simulated_sweeps
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from mnsf_ros.demo.node_process import NodeProcess, node_process
from mnsf_ros.node.environment import prepare_environment
from mnsf_ros.node.replay_link import ReceivedFlow, ReplayLink
from mnsf_ros.online.online_pipeline import TRIPLET_ENDS
from mnsf_ros.setting import Setting, SettingValue
from mnsf_ros.settings import declared_settings

# What was measured, the figure, and whether the promise holds.
Figure = tuple[str, str, bool]

_START_TIMEOUT_S: Final = 120
_FLOW_TIMEOUT_S: Final = 60
_QUIET_STATUSES: Final = 5
_FIRST_NS: Final = 10**18
# Each cloud that is published is counted by the node as one of these.
_CLOUD_EVENTS: Final = (
    *("sweeps_received", "clouds_undecodable", "clouds_empty"),
    *("clouds_missed", "sweeps_lost_in_transport"),
)


class LiveNode:
    """The node in a process of its own, with a publisher and a subscriber of its flow."""

    def __init__(self, process: NodeProcess, link: ReplayLink, log: Path) -> None:
        self.process = process
        self.link = link
        self.log = log
        self.published_s: dict[int, float] = {}
        self.arrived_s: dict[int, float] = {}
        self.num_published = 0
        self.num_good = 0

    def publish(self, raw: bytearray, interval_ns: int = INTERVAL_NS) -> None:
        """Publishes a good sweep with the next stamp."""
        stamped = with_stamp(raw, _FIRST_NS + self.num_good * interval_ns)
        now_s = time.monotonic()
        self.published_s[self.link.publish(stamped)] = now_s
        self.num_good += 1
        self.num_published += 1

    def settle(self) -> None:
        """Waits until the node is idle and its counts change no more."""
        deadline_s, last, before = time.monotonic() + _FLOW_TIMEOUT_S, None, 0
        while time.monotonic() < deadline_s:
            self.process.check()
            now = (dict(self.link.counts), len(self.arrived_s))
            if now != last:
                last, before = now, self.link.num_statuses
            is_idle = self.link.flow_values.get("busy") == "False"
            if is_idle and self.link.num_statuses - before >= _QUIET_STATUSES:
                return
            self.link.spin_for(0.1)

    def state(self) -> dict[str, float]:
        """What the process holds: memory (MB), open descriptors, threads, shared segments."""
        proc = Path("/proc", str(self.process.pid))
        maps = (line.split() for line in (proc / "maps").read_text().splitlines())
        return {
            "MB": self.process.resident_mb,
            "descriptors": len(list((proc / "fd").iterdir())),
            "threads": len(list((proc / "task").iterdir())),
            "segments": len({words[-1] for words in maps if words[-1].startswith("/dev/shm")}),
        }

    def balance(self) -> Iterator[Figure]:
        """Whether every cloud and every triplet is accounted for."""
        counts = self.link.counts
        counted = sum(counts.get(event, 0) for event in _CLOUD_EVENTS)
        clouds = f"{self.num_published:,} published, {counted:,} counted"
        yield "clouds accounted for", clouds, counted == self.num_published
        formed, ended = (
            counts.get("triplets_formed", 0),
            sum(counts.get(event, 0) for event in TRIPLET_ENDS),
        )
        yield "triplets accounted for", f"{formed:,} formed, {ended:,} ended", formed == ended
        tracebacks = self.log.read_text(errors="replace").count("Traceback")
        yield "tracebacks in the log", str(tracebacks), tracebacks == 0


@contextmanager
def live_node(*parameters: str) -> Iterator[LiveNode]:
    """Starts a node with parameters such as `node.always_estimate:=true` and waits for it."""
    prepare_environment()
    words = [word for parameter in parameters for word in ("-p", parameter)]
    with ExitStack() as stack:
        log = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "node.log"
        arguments = ["-r", "~/points:=/points", "-p", "node.diagnostics_period_s:=0.2", *words]
        process = stack.enter_context(node_process(arguments, log))

        def on_flow(flow: ReceivedFlow) -> None:
            node.arrived_s[flow.stamp_ns] = flow.arrived_s

        link = ReplayLink("/points", "/scene_flow/flow", on_flow, lambda raw: None)
        node = LiveNode(process, stack.enter_context(link), log)
        deadline_s = time.monotonic() + _START_TIMEOUT_S
        while not link.is_connected or not link.num_statuses:
            process.check()
            if time.monotonic() > deadline_s:
                raise process.failure("the node was not there in time")
            link.spin_for(0.1)
        yield node


def _clouds(**settings: int) -> Iterator[bytearray]:
    """Serialized sweeps of a simulated street, to and fro without end."""
    clouds = [serialized(item.sweep) for item in simulated_sweeps(0, 24, **settings)]
    return itertools.cycle([*clouds, *clouds[-2:0:-1]])


def soak(options: argparse.Namespace) -> Iterator[Figure]:
    """Full sweeps at 10 Hz: memory, descriptors, threads and segments stay what they are."""
    warm_up = round(min(600, options.hours * 900) * 10)
    with live_node() as node:
        clouds, start_s, early = _clouds(), time.monotonic(), {}
        for number in range(round(options.hours * 36_000)):
            node.link.spin_for(start_s + number / 10 - time.monotonic())
            node.process.check()
            node.publish(next(clouds))
            if number == warm_up:
                early = node.state()
        node.settle()
        late = node.state()
        yield "sweeps, flows", f"{node.num_published:,}, {len(node.arrived_s):,}", True
        growth_mb = late["MB"] - early["MB"]
        text = f"{growth_mb:+.1f} MB after the first {warm_up / 600:.0f} min, now {late['MB']:.0f}"
        yield "memory", text, growth_mb <= 20
        for name in ("descriptors", "threads", "segments"):
            yield name, f"{early[name]:.0f} -> {late[name]:.0f}", late[name] <= early[name]
        yield from node.balance()


def overload(options: argparse.Namespace) -> Iterator[Figure]:
    """20 Hz of 128 beams, more than the machine manages: latency stays bounded."""
    with live_node() as node:
        clouds, start_s = _clouds(num_beams=128, num_columns=1760), time.monotonic()
        for number in range(round(options.hours * 72_000)):
            node.link.spin_for(start_s + number / 20 - time.monotonic())
            node.process.check()
            node.publish(next(clouds), INTERVAL_NS // 2)
        node.settle()
        stamps = list(node.published_s)
        latencies = [
            node.arrived_s[stamp] - node.published_s[following]
            for stamp, following in itertools.pairwise(stamps)
            if stamp in node.arrived_s
        ]
        estimate_ms = float(node.link.flow_values.get("estimate median [ms]", math.nan))
        flows = f"{len(latencies):,} of {len(stamps):,} in {options.hours * 60:g} min"
        yield "flows", flows, 0 < len(latencies) < len(stamps)
        for percentile in (50, 99):
            latency_ms = float(np.percentile(latencies, percentile)) * 1e3
            text = f"{latency_ms:.0f} ms, an estimate takes {estimate_ms:.0f} ms"
            yield f"latency, {percentile}th percentile", text, latency_ms <= 2 * estimate_ms
        yield from node.balance()


def clouds(options: argparse.Namespace) -> Iterator[Figure]:
    """Hostile clouds of every kind between good sweeps."""
    random = np.random.default_rng(options.seed)
    good = serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)
    with live_node("node.always_estimate:=true") as node:
        answered, asked = 0, 0
        log_before = node.log.stat().st_size
        for number in range(options.number):
            node.process.check()
            between = with_stamp(good, _FIRST_NS + node.num_good * INTERVAL_NS - INTERVAL_NS // 2)
            node.link.publish_bytes(hostile(KINDS[number % len(KINDS)], between, random))
            node.num_published += 1
            node.publish(good)
            node.link.spin_for(options.pause_ms / 1e3)
            if number % 100 == 0:
                asked += 1
                answered += _is_answered(node, good)
        node.settle()
        counts = node.link.counts
        yield "hostile clouds", f"{options.number:,} of {len(KINDS)} kinds", True
        yield "alive, good sweeps answered", f"{answered} of {asked}", answered == asked
        bad = max(1, counts.get("clouds_undecodable", 0) + counts.get("clouds_empty", 0))
        log_bytes = (node.log.stat().st_size - log_before) / options.number
        yield "log", f"{log_bytes:.1f} bytes each; {bad:,} undecodable or empty", log_bytes <= 10
        yield from node.balance()


def _is_answered(node: LiveNode, good: bytearray) -> bool:
    """Whether flow comes for one of some good sweeps in a row."""
    before = len(node.arrived_s)
    deadline_s = time.monotonic() + _FLOW_TIMEOUT_S
    while len(node.arrived_s) == before and time.monotonic() < deadline_s:
        node.publish(good)
        node.link.spin_for(0.1)
    return len(node.arrived_s) > before


def parameters(options: argparse.Namespace) -> Iterator[Figure]:
    """Changes of parameters while sweeps come, valid and not."""
    random = np.random.default_rng(options.seed)
    sweep = simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep
    good = serialized(sweep)
    changeable = [setting for setting in declared_settings() if not setting.fixed]
    wrong: list[str] = []
    accepted, done, end_s = 0, 0, time.monotonic() + options.minutes * 60
    with live_node("compute.device:=cpu") as node, _Parameters() as client:
        for number in range(options.number):
            if time.monotonic() > end_s:
                break
            node.process.check()
            done += 1
            setting = changeable[int(random.integers(len(changeable)))]
            before, value = client.get(setting.name), _value(setting, random)
            is_accepted, after = client.set(setting.name, value), client.get(setting.name)
            accepted += is_accepted
            if not _is_as_said(after, value if is_accepted else before):
                wrong.append(f"{setting.name}: {before} -> {value}: {after}")
            if number % 10 == 0:
                node.publish(good)
                node.link.spin_for(0.01)
        for setting in changeable:
            client.set(setting.name, setting.default)
        node.link.spin_for(2.0)
        is_alive = _is_answered(node, good)
        changes = f"{done:,} of {options.number:,}, of them accepted {accepted:,}"
        yield "changes", changes, 0 < accepted < done
        yield "not as answered", f"{len(wrong)} {'; '.join(wrong[:3])}", not wrong
        yield "flow after the defaults are set, without a restart", str(is_alive), is_alive
        node.settle()
        yield from node.balance()


class _Parameters:
    """A client of the parameters of the node, in a context of its own."""

    def __enter__(self) -> _Parameters:
        self._context = Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("changes_parameters", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._client = AsyncParameterClient(self._node, "/scene_flow")
        self._client.wait_for_services(_START_TIMEOUT_S)
        return self

    def __exit__(self, *_error: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def get(self, name: str) -> object:
        """Value of a parameter."""
        future = self._client.get_parameters([name])
        self._executor.spin_until_future_complete(future, _FLOW_TIMEOUT_S)
        return parameter_value_to_python(future.result().values[0])

    def set(self, name: str, value: SettingValue | list[int]) -> bool:
        """Whether the node accepts a value."""
        future = self._client.set_parameters([Parameter(name, value=value)])
        self._executor.spin_until_future_complete(future, _FLOW_TIMEOUT_S)
        return bool(future.result().results[0].successful)


def _is_as_said(after: object, expected: object) -> bool:
    if isinstance(after, float) and isinstance(expected, (int, float)):
        return after == float(expected)
    return after == expected


def _value(setting: Setting, random: np.random.Generator) -> SettingValue | list[int]:
    """A value for a setting: near its default, at or beyond its limits, or of another type."""
    if random.random() < 0.2:
        others = (True, -7, 1e30, math.nan, "nonsense", "", [1, 2])
        return others[int(random.integers(len(others)))]
    if setting.choices:
        return setting.choices[int(random.integers(len(setting.choices)))]
    if setting.kind is bool:
        return bool(random.integers(2))
    if setting.minimum is None or setting.maximum is None:
        return ("online", "mnsf", "zero", "auto", "")[int(random.integers(5))]
    low, high = setting.minimum, setting.maximum
    # Up to its limits a network could take the memory of the whole machine.
    usual = float(setting.default) or (low + high) / 2
    near = min(max(usual * 4 ** random.uniform(-1, 1), low), high, 1e6)
    values = (near, near, near, low, low - 1, high + 1)
    value = values[int(random.integers(len(values)))]
    return int(value) if setting.kind is int else float(value)


PROMISES: Final[Mapping[str, object]] = {
    "soak": soak,
    "overload": overload,
    "clouds": clouds,
    "parameters": parameters,
}
__all__: Sequence[str] = ("PROMISES", "Figure", "LiveNode", "live_node")
