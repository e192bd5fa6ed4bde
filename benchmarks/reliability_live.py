"""Promises of the running node for `reliability.py`: soak, overload, clouds, parameters."""

from __future__ import annotations

import argparse
import itertools
import math
import time
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
import rclpy
from hostile_clouds import KINDS, hostile
from online_live import FIRST_NS, Figure, LiveNode, live_node, serialized, with_stamp
from online_recordings import INTERVAL_NS, simulated_sweeps, to_and_fro
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from mnsf_ros.setting import Setting, SettingValue
from mnsf_ros.settings import declared_settings

_START_TIMEOUT_S: Final = 120
_FLOW_TIMEOUT_S: Final = 60
_OFTEN: Final = "node.diagnostics_period_s:=0.2"


def _clouds(**settings: int) -> Iterator[bytearray]:
    """Serialized sweeps of a simulated street, to and fro without end."""
    return itertools.cycle(
        to_and_fro(serialized(s.sweep) for s in simulated_sweeps(0, 24, **settings))
    )


def soak(options: argparse.Namespace) -> Iterator[Figure]:
    """Full sweeps at 10 Hz: memory, descriptors, threads and segments stay what they are."""
    warm_up = round(min(600, options.hours * 900) * 10)
    with live_node(_OFTEN) as node:
        clouds, start_s, early = _clouds(), time.monotonic(), {}
        for number in range(round(options.hours * 36_000)):
            node.link.spin_for(start_s + number / 10 - time.monotonic())
            node.process.check()
            node.publish(next(clouds))
            if number == warm_up:
                early = node.state()
        node.settle()
        late = node.state()
        yield "sweeps, flows", f"{node.num_published:,}, {len(node.replay.arrived_s):,}", True
        growth_mb = late["MB"] - early["MB"]
        text = f"{growth_mb:+.1f} MB after the first {warm_up / 600:.0f} min, now {late['MB']:.0f}"
        yield "memory", text, growth_mb <= 20
        for name in ("descriptors", "threads", "segments"):
            yield name, f"{early[name]:.0f} -> {late[name]:.0f}", late[name] <= early[name]
        yield from node.balance()


def overload(options: argparse.Namespace) -> Iterator[Figure]:
    """20 Hz of 128 beams, more than the machine manages: latency stays bounded."""
    with live_node(_OFTEN) as node:
        clouds, start_s = _clouds(num_beams=128, num_columns=1760), time.monotonic()
        for number in range(round(options.hours * 72_000)):
            node.link.spin_for(start_s + number / 20 - time.monotonic())
            node.process.check()
            node.publish(next(clouds), INTERVAL_NS // 2)
        node.settle()
        latencies_ms, num_sweeps = node.replay.latencies_ms, len(node.replay.published_s)
        estimate_ms = float(node.link.flow_values.get("estimate median [ms]", math.nan))
        flows = f"{len(latencies_ms):,} of {num_sweeps:,} in {options.hours * 60:g} min"
        yield "flows", flows, 0 < len(latencies_ms) < num_sweeps
        for percentile in (50, 99):
            latency_ms = float(np.percentile(latencies_ms, percentile))
            text = f"{latency_ms:.0f} ms, an estimate takes {estimate_ms:.0f} ms"
            yield f"latency, {percentile}th percentile", text, latency_ms <= 2 * estimate_ms
        yield from node.balance()


def clouds(options: argparse.Namespace) -> Iterator[Figure]:
    """Hostile clouds of every kind between good sweeps."""
    random = np.random.default_rng(options.seed)
    good = serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)
    with live_node(_OFTEN, "node.always_estimate:=true") as node:
        answered, asked = 0, 0
        log_before = node.log.stat().st_size
        for number in range(options.number):
            node.process.check()
            between = with_stamp(good, FIRST_NS + node.num_good * INTERVAL_NS - INTERVAL_NS // 2)
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
    before = len(node.replay.arrived_s)
    deadline_s = time.monotonic() + _FLOW_TIMEOUT_S
    while len(node.replay.arrived_s) == before and time.monotonic() < deadline_s:
        node.publish(good)
        node.link.spin_for(0.1)
    return len(node.replay.arrived_s) > before


def parameters(options: argparse.Namespace) -> Iterator[Figure]:
    """Changes of parameters while sweeps come, valid and not."""
    random = np.random.default_rng(options.seed)
    sweep = simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep
    good = serialized(sweep)
    changeable = [setting for setting in declared_settings() if not setting.fixed]
    wrong: list[str] = []
    accepted, done, end_s = 0, 0, time.monotonic() + options.minutes * 60
    with live_node(_OFTEN, "compute.device:=cpu") as node, _Parameters() as client:
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
