# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Every setting as a ROS parameter, of the own node and of one in another process."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from mnsf_ros.core.compute_device import node_threads
from mnsf_ros.errors import SettingsError, did_you_mean, shortened
from mnsf_ros.setting import Setting, SettingValue
from mnsf_ros.settings import Settings, declared_settings

# Takes the next settings; raises SettingsError if they cannot be used.
SettingsChange: TypeAlias = Callable[[Settings], None]


class UnknownParameterError(ParameterNotDeclaredException):
    """The node does not have this parameter; rclpy's own error does not name it."""

    def __init__(self, name: str) -> None:
        known = ["use_sim_time", *(setting.name for setting in declared_settings())]
        hint = did_you_mean(name, known)
        Exception.__init__(self, f"unknown parameter {shortened(name)}{hint}")


class NodeParameters:
    """The settings of a node as its parameters."""

    def __init__(self, node: Node, *, has_life_cycle: bool = False) -> None:
        """Declares the parameters and reads the values that the user gave.

        The fixed ones are read-only; with a life cycle they may change until it is configured.

        Raises:
            SettingsError: If a given value does not fit; one line that names the parameter.
        """
        self._given = _declared(node, has_life_cycle=has_life_cycle)
        self._on_change: SettingsChange | None = None
        node.add_on_set_parameters_callback(self._set)

    @property
    def settings(self) -> Settings:
        """The current settings; unless given, the threads leave one core to the executor."""
        return _with_threads(self._given)

    def follow(self, on_change: SettingsChange | None) -> None:
        """Sets the callback before each change, which may refuse it; None while unconfigured."""
        self._on_change = on_change

    def _set(self, parameters: list[Parameter]) -> SetParametersResult:
        """Changes the settings after `ros2 param set`, or refuses with the reason."""
        try:
            own = {setting.name for setting in declared_settings()}
            changes = {item.name: item.value for item in parameters if item.name in own}
            settings = self._given.changed(changes)
            if self._on_change is not None:
                _check_fixed(self._given, settings)
                self._on_change(_with_threads(settings))
        except SettingsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:  # noqa: BLE001 - the client gets no answer otherwise
            reason = f"{type(error).__name__}: {error}"
            return SetParametersResult(successful=False, reason=reason)
        self._given = settings
        return SetParametersResult(successful=True)


def _with_threads(settings: Settings) -> Settings:
    if settings.compute.num_threads:
        return settings
    return replace(settings, compute=replace(settings.compute, num_threads=node_threads()))


def _check_fixed(before: Settings, after: Settings) -> None:
    for setting in declared_settings():
        if setting.fixed and before.value_of(setting.name) != after.value_of(setting.name):
            raise SettingsError(f"{setting.name} is fixed until the node is cleaned up")


def _declared(node: Node, *, has_life_cycle: bool) -> Settings:
    given: dict[str, object] = {}
    overrides = _overrides(node)
    for setting in declared_settings():
        override = overrides.get(setting.name)
        value = setting.default if override is None else setting.checked(override.value)
        parameter = node.declare_parameter(
            setting.name,
            value,
            _descriptor(setting, is_read_only=setting.fixed and not has_life_cycle),
            ignore_override=True,
        )
        given[setting.name] = parameter.value
    node.add_pre_set_parameters_callback(partial(_in_declared_types, node))
    return Settings().changed(given)


def undeclared_overrides(node: Node) -> list[str]:
    """Names of given parameters that the node does not have: typos, mostly."""
    return sorted(name for name in _overrides(node) if not node.has_parameter(name))


def _overrides(node: Node) -> dict[str, Parameter]:
    # rclpy drops unknown ones without a word and offers no public way to see them.
    return getattr(node, "_parameter_overrides", {})


def _in_declared_types(node: Node, parameters: list[Parameter]) -> list[Parameter]:
    """The parameters in their declared types: 60 as 60.0 where a float is declared."""
    settings = {setting.name: setting for setting in declared_settings()}
    typed = []
    for item in parameters:
        if not node.has_parameter(item.name):
            raise UnknownParameterError(item.name)
        value = item.value
        if item.name in settings:
            with suppress(SettingsError):  # what does not fit is refused later
                value = settings[item.name].checked(value)
        typed.append(item if value is item.value else Parameter(item.name, value=value))
    return typed


def _descriptor(setting: Setting, *, is_read_only: bool) -> ParameterDescriptor:
    unit = f" [{setting.unit}]" if setting.unit else ""
    descriptor = ParameterDescriptor(
        description=f"{setting.text}{unit}",
        read_only=is_read_only,
        # The settings check the type, and say what they expect.
        dynamic_typing=True,
    )
    if setting.choices:
        descriptor.additional_constraints = f"one of {', '.join(setting.choices)}"
    elif setting.minimum is not None and setting.maximum is not None:
        low, high = setting.kind(setting.minimum), setting.kind(setting.maximum)
        if setting.kind is int:
            descriptor.integer_range = [IntegerRange(from_value=low, to_value=high)]
        else:
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return descriptor


class RemoteParameters:
    """The settings of a node in another process; answers arrive while the own node spins."""

    def __init__(
        self,
        node: Node,
        remote: str,
        on_values: Callable[[dict[str, Any]], None],
        on_refused: Callable[[str], None],
    ) -> None:
        """Makes the client of a node.

        Args:
            node: The own node.
            remote: Full name of the other node.
            on_values: Called with all settings by their names, when they are other than before.
            on_refused: Called with the reason why a value was refused.
        """
        self._remote, self._on_values, self._on_refused = remote, on_values, on_refused
        self._names = [setting.name for setting in declared_settings()]
        self._client = AsyncParameterClient(node, remote)
        self._values: dict[str, Any] = {}

    def ask(self) -> None:
        """Asks for all values, if the node is there; to be called now and then."""
        if self._client.services_are_ready():
            self._client.get_parameters(self._names, self._receive_values)
        else:
            self._values = {}

    def set(self, values: Mapping[str, SettingValue]) -> None:
        """Sets parameters as `ros2 param set` does."""
        if not self._client.services_are_ready():
            self._on_refused(f"{self._remote} is not running")
            return
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        self._client.set_parameters(parameters, self._receive_results)

    def _receive_values(self, future: Any) -> None:  # noqa: ANN401 - of rclpy
        values = map(parameter_value_to_python, future.result().values)
        named = zip(self._names, values, strict=False)
        known = {name: value for name, value in named if value is not None}
        if known != self._values:
            self._values = known
            self._on_values(known)

    def _receive_results(self, future: Any) -> None:  # noqa: ANN401
        reasons = [one.reason for one in future.result().results if not one.successful]
        if reasons:
            self._on_refused("; ".join(reasons))
        else:
            self.ask()
