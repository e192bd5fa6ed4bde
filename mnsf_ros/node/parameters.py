"""Every setting as a ROS parameter: declared, checked, changed while running."""

from __future__ import annotations

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from mnsf_ros.errors import SettingsError
from mnsf_ros.settings import Setting, Settings, declared_settings


def declare_parameters(node: Node) -> Settings:
    """Declares all settings as parameters of the node and reads what the user gave.

    Raises:
        SettingsError: If a given value does not fit; one line that names the parameter.
    """
    given: dict[str, object] = {}
    for setting in declared_settings():
        try:
            parameter = node.declare_parameter(setting.name, setting.default, _descriptor(setting))
        except ParameterException as error:
            raise SettingsError(f"parameter {setting.name}: {error}") from None
        given[setting.name] = parameter.value
    return Settings().changed(given)


def undeclared_overrides(node: Node) -> list[str]:
    """Parameters that the user gave but the node does not have: typos, mostly."""
    # rclpy drops them without a word and offers no public way to see them.
    overrides: dict[str, Parameter] = getattr(node, "_parameter_overrides", {})
    return sorted(name for name in overrides if not node.has_parameter(name))


def changed_settings(settings: Settings, parameters: list[Parameter]) -> Settings:
    """Returns the settings after `ros2 param set`; leaves out what is no setting.

    Raises:
        SettingsError: If a value does not fit.
    """
    names = {setting.name for setting in declared_settings()}
    return settings.changed({item.name: item.value for item in parameters if item.name in names})


def _descriptor(setting: Setting) -> ParameterDescriptor:
    unit = f" [{setting.unit}]" if setting.unit else ""
    descriptor = ParameterDescriptor(
        description=f"{setting.text}{unit}",
        read_only=setting.fixed,
        # Otherwise 70 for a float parameter is an error; the settings convert and check.
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
