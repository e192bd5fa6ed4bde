# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Changes of the node's parameters, for `reliability.py`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
import rclpy
from online_live import live_node, serialized
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
}
