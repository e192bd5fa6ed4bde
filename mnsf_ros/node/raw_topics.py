# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Topics of the ROS graph, of any type, for programs beside the node."""

import importlib
import inspect
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final, TypeVar

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from mnsf_ros.errors import MnsfError
from mnsf_ros.node.environment import leaving_ros

_TYPE_NAME: Final = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")
_DEPTH: Final = 5
_MAX_SPIN_S: Final = 0.1  # until a Ctrl-C is answered

Self = TypeVar("Self", bound="RawTopics")


class MessageTypeError(MnsfError):
    """The package of a message type is not installed."""


def message_class(msgtype: str) -> Any:  # noqa: ANN401 - a class of ROS
    """Returns the class of a type such as `sensor_msgs/msg/PointCloud2`.

    Raises:
        MessageTypeError: It cannot be imported.
    """
    match = _TYPE_NAME.fullmatch(msgtype)
    try:
        found = getattr(importlib.import_module(f"{match[1]}.msg"), match[2]) if match else None
    except (ImportError, AttributeError):
        found = None
    if not inspect.isclass(found) or not hasattr(found, "_TYPE_SUPPORT"):
        raise MessageTypeError(f"the message type {msgtype} is not installed")
    return found


def begins_with_header(msgtype: str) -> bool:
    """Whether messages of an installed type begin with a header, which has a stamp.

    Raises:
        MessageTypeError: The type cannot be imported.
    """
    fields = message_class(msgtype).get_fields_and_field_types()
    return next(iter(fields.items()), None) == ("header", "std_msgs/Header")


class RawTopics:
    """A ROS node of its own context, driven by the caller: nothing happens outside of `spin_for`.

    Use it as a context manager. A process that cannot leave the ROS graph ends with status 1.

    Attributes:
        node: The node itself, to query the ROS graph.
    """

    def __init__(self, name: str, **remapped: str) -> None:
        """Starts the node; `remapped` has names of its own topics, as `points` for `~/points`."""
        self._context = Context()
        rclpy.init(args=[], context=self._context)
        rules = [word for key, to in remapped.items() for word in ("-r", f"~/{key}:={to}")]
        arguments = ["--ros-args", *rules] if rules else []
        self.node = rclpy.create_node(name, context=self._context, cli_args=arguments)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def __enter__(self: Self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        with leaving_ros():
            self._executor.shutdown()
            self.node.destroy_node()
            self._context.try_shutdown()

    def publisher(self, topic: str, msgtype: str, *, is_latched: bool = False) -> Any:  # noqa: ANN401
        """Returns a reliable publisher; its `publish` takes serialized messages, too.

        Raises:
            MessageTypeError: The type is not installed.
        """
        return self.node.create_publisher(message_class(msgtype), topic, _qos(is_latched))

    def subscribe(self, topic: str, msgtype: str, on_message: Callable[[Any], None]) -> Any:  # noqa: ANN401
        """Calls `on_message` with each message of a topic; returns the subscription.

        Raises:
            MessageTypeError: The type is not installed.
        """
        return self.node.create_subscription(message_class(msgtype), topic, on_message, _qos())

    def clock(self) -> Callable[[int], None]:
        """Returns a function that publishes a time in nanoseconds on /clock."""
        publisher = self.node.create_publisher(Clock, "/clock", _DEPTH)

        def publish(time_ns: int) -> None:
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(time_ns, 10**9)
            publisher.publish(message)

        return publish

    def spin_for(self, duration_s: float) -> None:
        """Handles the messages that arrive within a duration."""
        deadline_s = time.monotonic() + duration_s
        while (left_s := deadline_s - time.monotonic()) > 0:
            with _interrupted_after():
                self._executor.spin_once(timeout_sec=min(left_s, _MAX_SPIN_S))


@contextmanager
def _interrupted_after() -> Iterator[None]:
    """Keeps a Ctrl-C back until the end of the block: rclpy makes it an error of another kind."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    met: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: met.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
    if met:
        signal.raise_signal(signal.SIGINT)


def _qos(is_latched: bool = False) -> QoSProfile:
    kept = DurabilityPolicy.TRANSIENT_LOCAL if is_latched else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.RELIABLE, durability=kept)
