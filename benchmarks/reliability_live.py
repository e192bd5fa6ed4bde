"""Promises of the running node for `reliability.py`: soak, overload, clouds, parameters."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator
from typing import Final

import numpy as np
import rclpy
from hostile_clouds import KINDS, hostile
from online_live import FIRST_NS, LiveNode, live_node, serialized, with_stamp
from online_recordings import INTERVAL_NS, simulated_sweeps, to_and_fro
from promises import Figure, Promise, Rounds
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from mnsf_ros.setting import Setting, SettingValue
from mnsf_ros.settings import declared_settings
from mnsf_ros.sweeps.sweep import Sweep

_START_TIMEOUT_S: Final = 120
_FLOW_TIMEOUT_S: Final = 60
_HUGE: Final = 2_000_000
_PAUSE_S: Final = 0.02
_SWEEPS_A_MINUTE: Final = 600
_WARM_UP_MIN: Final = 10
_MAX_GROWTH_MB: Final = 20
# Otherwise the machine was not overloaded.
_MIN_DROPPED: Final = 0.1
_OFTEN: Final = "node.diagnostics_period_s:=0.2"


def _clouds(**settings: int) -> Iterator[bytearray]:
    """Serialized sweeps of a simulated street, to and fro without end."""
    return itertools.cycle(
        to_and_fro(serialized(s.sweep) for s in simulated_sweeps(0, 24, **settings))
    )


def soak(rounds: Rounds) -> Iterator[Figure]:
    """Full sweeps at 10 Hz: memory, descriptors, threads and segments stay what they are."""
    with live_node(_OFTEN) as node:
        clouds, start_s = _clouds(), time.monotonic()
        states: list[dict[str, float]] = []
        for _ in rounds:
            node.link.spin_for(start_s + node.num_published / 10 - time.monotonic())
            node.process.check()
            node.publish(next(clouds))
            if node.num_published % _SWEEPS_A_MINUTE == 0:
                states.append(node.state())
        node.settle()
        late = node.state()
        # Of a short run, the first third.
        warm_up = min(_WARM_UP_MIN, len(states) // 3)
        early = states[warm_up - 1] if warm_up else late
        yield "flows", f"{len(node.replay.arrived_s):,}", bool(node.replay.arrived_s)
        growth_mb = late["MB"] - early["MB"]
        text = f"{growth_mb:+.1f} MB after the first {warm_up} min, now {late['MB']:.0f} MB"
        yield "memory", text, growth_mb <= _MAX_GROWTH_MB
        for name in ("descriptors", "threads", "segments"):
            yield name, f"{early[name]:.0f} -> {late[name]:.0f}", late[name] <= early[name]
        yield from node.balance()


def large_clouds(rounds: Rounds) -> Iterator[Figure]:
    """Full sweeps, then five clouds of two million points, then full sweeps again."""
    with live_node(_OFTEN) as node:
        clouds, huge = _clouds(), serialized(_huge_sweep())
        for _ in rounds:
            states = []
            for number, cloud in ((100, None), (5, huge), (200, None)):
                for _ in range(number):
                    node.process.check()
                    node.publish(cloud or next(clouds))
                    node.link.spin_for(0.1 if cloud is None else 2.0)
                node.settle()
                states.append(node.state()["MB"])
            yield "memory before, during, after", " -> ".join(f"{mb:.0f}" for mb in states), True
        yield from node.balance()


def _huge_sweep() -> Sweep:
    """Two million points along a street."""
    xyz = simulated_sweeps(0, 1)[0].sweep.xyz
    xyz = np.resize(xyz, (_HUGE, 3))
    random = np.random.default_rng(0)
    return Sweep(xyz + random.normal(0, 0.05, xyz.shape).astype(np.float32), 0, "lidar")


def overload(rounds: Rounds) -> Iterator[Figure]:
    """20 Hz of full sweeps, more than the machine manages: latency stays bounded."""
    estimates_ms = []
    with live_node(_OFTEN) as node:
        clouds, start_s = _clouds(), time.monotonic()
        for _ in rounds:
            node.link.spin_for(start_s + node.num_published / 20 - time.monotonic())
            node.process.check()
            node.publish(next(clouds), INTERVAL_NS // 2)
            estimates_ms.append(float(node.link.flow_values.get("estimate median [ms]", math.nan)))
        node.settle()
        latencies_ms, num_sweeps = node.replay.latencies_ms, len(node.replay.published_s)
        dropped = num_sweeps - len(latencies_ms)
        flows = f"{len(latencies_ms):,}, without {dropped:,}"
        yield "flows", flows, bool(latencies_ms) and dropped > _MIN_DROPPED * num_sweeps
        for percentile in (50, 95, 99):
            latency_ms = float(np.percentile(latencies_ms, percentile))
            estimate_ms = float(np.nanpercentile(estimates_ms, percentile))
            text = f"{latency_ms:.0f} ms, an estimate takes {estimate_ms:.0f} ms"
            yield f"latency, {percentile}th percentile", text, latency_ms <= 2 * estimate_ms
        yield from node.balance()


def clouds(rounds: Rounds) -> Iterator[Figure]:
    """Hostile clouds of every kind between good sweeps."""
    good = serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)
    with live_node(_OFTEN, "node.always_estimate:=true") as node:
        answered, asked = 0, 0
        log_before = node.log.stat().st_size
        for number, random in rounds:
            node.process.check()
            between = with_stamp(good, FIRST_NS + node.num_good * INTERVAL_NS - INTERVAL_NS // 2)
            node.link.publish_bytes(hostile(KINDS[number % len(KINDS)], between, random))
            node.num_published += 1
            node.publish(good)
            node.link.spin_for(_PAUSE_S)
            if number % 100 == 0:
                asked += 1
                answered += _is_answered(node, good)
        node.settle()
        counts = node.link.counts
        yield f"of {len(KINDS)} kinds, good sweeps answered", *_of(answered, asked)
        bad = max(1, counts.get("clouds_undecodable", 0) + counts.get("clouds_empty", 0))
        log_bytes = (node.log.stat().st_size - log_before) / rounds.done
        yield "log", f"{log_bytes:.1f} bytes each; {bad:,} undecodable or empty", log_bytes <= 10
        yield from node.balance()


def _of(number: int, whole: int) -> tuple[str, bool]:
    return f"{number:,} of {whole:,}", number == whole


def _is_answered(node: LiveNode, good: bytearray) -> bool:
    """Whether flow comes for one of some good sweeps in a row."""
    before = len(node.replay.arrived_s)
    deadline_s = time.monotonic() + _FLOW_TIMEOUT_S
    while len(node.replay.arrived_s) == before and time.monotonic() < deadline_s:
        node.publish(good)
        node.link.spin_for(0.1)
    return len(node.replay.arrived_s) > before


def parameters(rounds: Rounds) -> Iterator[Figure]:
    """Changes of parameters while sweeps come, valid and not."""
    good = serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)
    changeable = [setting for setting in declared_settings() if not setting.fixed]
    names = [setting.name for setting in changeable]
    wrong: list[str] = []
    accepted = 0
    with live_node(_OFTEN, "compute.device:=cpu") as node, _Parameters() as client:
        expected = client.get(names)
        for number, random in rounds:
            node.process.check()
            setting = changeable[int(random.integers(len(changeable)))]
            value = _value(setting, random)
            is_accepted = client.set(setting.name, value)
            accepted += is_accepted
            if is_accepted:
                expected[setting.name] = value
            for name, found in client.get(names).items():
                if not _is_as_said(found, expected[name]):
                    wrong.append(f"{setting.name} = {value}: {name} is {found}")
                    expected[name] = found
            if number % 10 == 0:
                node.publish(good)
                node.link.spin_for(0.01)
        for setting in changeable:
            client.set(setting.name, setting.default)
        node.link.spin_for(2.0)
        is_alive = _is_answered(node, good)
        yield "accepted", f"{accepted:,}", 0 < accepted < rounds.done
        yield "other values than said", f"{len(wrong)} {'; '.join(wrong[:3])}", not wrong
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

    def get(self, names: list[str]) -> dict[str, object]:
        """Values of parameters."""
        future = self._client.get_parameters(names)
        self._executor.spin_until_future_complete(future, _FLOW_TIMEOUT_S)
        values = map(parameter_value_to_python, future.result().values)
        return dict(zip(names, values, strict=True))

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


PROMISES: Final = {
    "parameters": Promise(
        "parameters changed while the node runs, valid and not: nothing refused takes effect, "
        "nothing else changes, nothing needs a restart",
        *(5_000, "changes", parameters),
    ),
    "clouds": Promise(
        "hostile clouds of every kind between good sweeps: alive, good sweeps answered, "
        "everything accounted for, log at most 10 bytes each",
        *(10_000, "clouds", clouds),
    ),
    "large": Promise(
        "five clouds of two million points: their memory goes back",
        *(1, "times", large_clouds),
    ),
    "overload": Promise(
        "1 h at 20 Hz, more than the machine manages: latency at most that of two estimates, "
        "every triplet out or counted",
        *(72_000, "sweeps", overload),
    ),
    "soak": Promise(
        "24 h at 10 Hz, full sweeps: growth at most 20 MB after the first 10 min, no descriptor, "
        "thread or segment more, everything accounted for",
        *(864_000, "sweeps", soak),
    ),
}
