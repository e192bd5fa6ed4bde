# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Changes of the node's parameters, for `reliability.py`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
import rclpy
from online_live import LiveNode, live_node, serialized
from online_recordings import simulated_sweeps
from promises import Figure, Promise, Rounds
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from reliability_live import OFTEN, is_answered

from mnsf_ros.setting import Setting, SettingValue
from mnsf_ros.settings import declared_settings

_TIMEOUT_S: Final = 120
_ENDLESS: Final[dict[str, SettingValue]] = {
    "method.name": "mnsf",
    "optimization.max_iterations": 100_000,
    "optimization.time_budget_ms": 0,
}
_STATUSES: Final = 5
_MAX_WAIT_S: Final = 1.0
_SILENT_S: Final = 2.0


def parameters(rounds: Rounds) -> Iterator[Figure]:
    """Changes of parameters while sweeps come, valid and not."""
    good = serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)
    changeable = [setting for setting in declared_settings() if not setting.fixed]
    names = [setting.name for setting in changeable]
    wrong: list[str] = []
    accepted = 0
    with live_node(OFTEN, "compute.device:=cpu") as node, _Parameters() as client:
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
        is_alive = is_answered(node, good)
        yield "accepted", f"{accepted:,}", 0 < accepted < rounds.done
        yield "other values than said", f"{len(wrong)} {'; '.join(wrong[:3])}", not wrong
        yield "flow after the defaults are set, without a restart", str(is_alive), is_alive
        node.settle()
        yield from node.balance()


def abandoned(rounds: Rounds) -> Iterator[Figure]:
    """Settings of an estimate that would last for hours are changed back while it is under way."""
    good = serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)
    waits_s: list[float] = []
    with (
        live_node(OFTEN, "compute.device:=cpu", "node.always_estimate:=true") as node,
        _Parameters() as client,
    ):
        is_answered(node, good)
        for _, random in rounds:
            node.process.check()
            for name, value in _ENDLESS.items():
                client.set(name, value)
            # What the node said before the change is not what counts.
            said = node.link.num_statuses + _STATUSES
            _publish_until(node, good, lambda said=said: _is_busy(node, said))
            node.link.spin_for(random.uniform(0, 1))
            flows, start_s = len(node.replay.arrived_s), time.monotonic()
            client.set("method.name", "online")
            _publish_until(node, good, lambda flows=flows: len(node.replay.arrived_s) > flows)
            waits_s.append(time.monotonic() - start_s)
        waits_s = waits_s or [math.nan]
        text = f"median {np.median(waits_s):.2f} s, {max(waits_s):.2f} s at most"
        text += f", {waits_s[0]:.2f} s the first time, after PyTorch was loaded"
        yield "flow after the change", text, max(waits_s) <= _MAX_WAIT_S
        # What the node has said last may be older than the last round.
        node.settle()
        count = node.link.counts.get("triplets_abandoned", 0)
        yield "abandoned", f"{count:,}", count >= rounds.done
        yield from node.balance()


def _is_busy(node: LiveNode, said: int) -> bool:
    """Whether a triplet waits for an estimate under way, as messages after some number say.

    The estimate is an endless one: the method before, which goes on until PyTorch is loaded, would
    have given flow meanwhile.
    """
    is_silent = time.monotonic() - max(node.replay.arrived_s.values()) > _SILENT_S
    return is_silent and node.link.num_statuses > said and node.link.flow_values.get("queue") == "1"


def _publish_until(node: LiveNode, good: bytearray, is_there: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + _TIMEOUT_S
    while not is_there() and time.monotonic() < deadline_s:
        node.publish(good)
        node.link.spin_for(0.1)


class _Parameters:
    """A client of the parameters of the node, in a context of its own."""

    def __enter__(self) -> _Parameters:
        self._context = Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("changes_parameters", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._client = AsyncParameterClient(self._node, "/scene_flow")
        self._client.wait_for_services(_TIMEOUT_S)
        return self

    def __exit__(self, *_error: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def get(self, names: list[str]) -> dict[str, object]:
        """Values of parameters."""
        future = self._client.get_parameters(names)
        self._executor.spin_until_future_complete(future, _TIMEOUT_S)
        values = map(parameter_value_to_python, future.result().values)
        return dict(zip(names, values, strict=True))

    def set(self, name: str, value: SettingValue | list[int]) -> bool:
        """Whether the node accepts a value."""
        future = self._client.set_parameters([Parameter(name, value=value)])
        self._executor.spin_until_future_complete(future, _TIMEOUT_S)
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
    "abandoned": Promise(
        "settings of an estimate that would last for hours, changed back: flow within a second",
        *(100, "changes", abandoned),
    ),
}
