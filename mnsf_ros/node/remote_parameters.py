# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The parameters of a running node, seen and set from another process."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import qos_profile_parameter_events

from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import declared_settings


class RemoteParameters:
    """Follows the settings of a node, by whomever they are set.

    Everything is asked for in the background: answers arrive while the own node spins.
    """

    def __init__(
        self,
        node: Node,
        remote: str,
        on_values: Callable[[dict[str, Any]], None],
        on_refused: Callable[[str], None],
    ) -> None:
        """Starts to follow.

        Args:
            node: The own node.
            remote: Full name of the other node.
            on_values: Called with settings by their names: all at first, later those changed.
            on_refused: Called with the reason why a value was refused.
        """
        self._node, self._remote = node, remote
        self._on_values, self._on_refused = on_values, on_refused
        self._names = [setting.name for setting in declared_settings()]
        self._client = AsyncParameterClient(node, remote)
        self._is_asked = False
        self._events = node.create_subscription(
            ParameterEvent, "/parameter_events", self._receive_event, qos_profile_parameter_events
        )

    def ask(self) -> None:
        """Asks a node that has come up for all values; to be called now and then."""
        is_there = self._client.services_are_ready()
        if is_there and not self._is_asked:
            self._client.get_parameters(self._names, self._receive_values)
        self._is_asked = is_there

    def set(self, values: Mapping[str, SettingValue]) -> None:
        """Sets parameters as `ros2 param set` does."""
        if not self._client.services_are_ready():
            self._on_refused(f"{self._remote} is not running")
            return
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        self._client.set_parameters(parameters, self._receive_results)

    def _receive_values(self, future: Any) -> None:  # noqa: ANN401 - of rclpy
        values = map(parameter_value_to_python, future.result().values)
        self._tell(dict(zip(self._names, values, strict=False)))

    def _receive_results(self, future: Any) -> None:  # noqa: ANN401
        reasons = [one.reason for one in future.result().results if not one.successful]
        if reasons:
            self._on_refused("; ".join(reasons))

    def _receive_event(self, event: ParameterEvent) -> None:
        if event.node == self._remote:
            changed = (*event.new_parameters, *event.changed_parameters)
            self._tell({one.name: parameter_value_to_python(one.value) for one in changed})

    def _tell(self, values: dict[str, Any]) -> None:
        known = {name: values[name] for name in self._names if values.get(name) is not None}
        if known:
            self._on_values(known)

    def close(self) -> None:
        """Ends following."""
        self._node.destroy_subscription(self._events)
