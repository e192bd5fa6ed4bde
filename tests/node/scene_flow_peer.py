# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The other end of the scene flow node: a lidar, a listener and a parameter client in one."""

from __future__ import annotations

import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile, ReliabilityPolicy
from scene_flow_process import PATIENCE_S
from sensor_msgs.msg import PointCloud2

from mnsf_ros.online.online_pipeline import TRIPLET_ENDS

# No cloud may be overwritten while a test does something else.
_DEPTH = 500

# Each cloud that a node receives is counted as one of these.
_CLOUD_EVENTS = ("sweeps_received", "clouds_undecodable", "clouds_empty")


class SceneFlowPeer:
    """Publishes clouds, receives flow and diagnostics, sets parameters; spins while it waits.

    Attributes:
        process: The node.
        flows: Received clouds with flow by their stamp, nanoseconds.
        diagnostics: Received diagnostics of the node, oldest first: `input` and `flow` to status.
    """

    def __init__(self, process, node_name, *, watches=True, reliable=True, points=None):
        self.process = process
        self._node_name = node_name
        self.points_topic = points or f"{node_name}/points"
        self.flow_topic = f"{node_name}/flow"
        self.node = rclpy.create_node(f"peer_of{node_name.replace('/', '_')}")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._clients = {}
        self._parameters = AsyncParameterClient(self.node, node_name)
        self._publisher = None
        self._flow_subscription = None
        self.flows = {}
        self.diagnostics = []
        # Of diagnostics only the newest: old ones would be taken for what is true now.
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 1)
        if reliable is not None:
            self.advertise(reliable=reliable)
        if watches:
            self.watch()

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()

    # Clouds and flow

    def advertise(self, *, reliable):
        """Starts to publish clouds; the last publisher ends."""
        self.stop_advertising()
        policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        self._publisher = self.node.create_publisher(
            PointCloud2, self.points_topic, QoSProfile(depth=_DEPTH, reliability=policy)
        )

    def stop_advertising(self):
        if self._publisher is not None:
            self.node.destroy_publisher(self._publisher)
        self._publisher = None

    def watch(self, *, reliable=True):
        """Subscribes to the flow."""
        policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        self._flow_subscription = self.node.create_subscription(
            PointCloud2,
            self.flow_topic,
            self._on_flow,
            QoSProfile(depth=_DEPTH, reliability=policy),
        )

    def stop_watching(self):
        if self._flow_subscription is not None:
            self.node.destroy_subscription(self._flow_subscription)
        self._flow_subscription = None

    def publish(self, message):
        """Publishes a cloud, or the raw bytes of one."""
        self._publisher.publish(message)

    def send(self, *messages):
        """Publishes clouds, each after the node has counted the last one, in whatever way."""
        for message in messages:
            before = self.num_clouds
            self.publish(message)
            self.spin_until(
                lambda before=before: self.num_clouds > before, "the cloud to be counted"
            )

    def send_until(self, messages, condition, what):
        """Publishes clouds, as a lidar does, until the condition is true after one."""
        clouds = iter(messages)

        def is_true_after_a_cloud():
            self.send(next(clouds))
            return condition()

        self.spin_until(is_true_after_a_cloud, what)

    def flow_of(self, message):
        """The flow of a cloud, once it has come."""
        stamp_ns = stamp_of(message)
        return self.spin_until(lambda: self.flows.get(stamp_ns), f"the flow of {stamp_ns}")

    @property
    def num_subscribers(self):
        """Subscriptions that the publisher of this peer knows of."""
        return self._publisher.get_subscription_count()

    def names_and_types(self, names_of):
        """What the node has, by a function of rclpy.node.Node, as far as it is known here yet."""
        namespace, _, name = self._node_name.rpartition("/")
        known = (name, namespace or "/")
        self.spin_until(
            lambda: known in self.node.get_node_names_and_namespaces(), "the name of the node"
        )
        return getattr(self.node, names_of)(*known)

    # Diagnostics

    @property
    def num_clouds(self):
        """Clouds that the node says it has received."""
        return sum(self.count(event) for event in _CLOUD_EVENTS)

    @property
    def num_open_triplets(self):
        """Triplets that the node has formed and not yet done anything with."""
        return self.count("triplets_formed") - sum(self.count(end) for end in TRIPLET_ENDS)

    def count(self, event):
        """How often the event has happened, as the newest diagnostics say."""
        return int((self.values("input") | self.values("flow")).get(event, 0))

    def values(self, part):
        """Key to value of the newest diagnostics of `input` or `flow`."""
        status = self.status(part)
        return {item.key: item.value for item in status.values} if status else {}

    def status(self, part):
        """The newest status of `input` or `flow`, None if there was none yet."""
        return self.diagnostics[-1][part] if self.diagnostics else None

    # Parameters

    def set(self, changes):
        """Sets parameters one by one; the results in their order."""
        return self._answer("set_parameters", _parameters(changes)).results

    def set_atomically(self, changes):
        """Sets parameters all at once or not at all; the result."""
        return self._answer("set_parameters_atomically", _parameters(changes)).result

    def set_without_waiting(self, changes):
        """Sets parameters by a request that the node may never answer."""
        self._parameters.set_parameters(_parameters(changes))

    def get(self, name):
        """Value of a parameter."""
        (value,) = self._answer("get_parameters", [name]).values
        return parameter_value_to_python(value)

    def describe(self, name):
        """Descriptor of a parameter."""
        return self._answer("describe_parameters", [name]).descriptors[0]

    def parameter_names(self):
        """Names of all parameters of the node."""
        return set(self._answer("list_parameters").result.names)

    def _answer(self, request, *arguments):
        self.spin_until(self._parameters.services_are_ready, "the parameter services")
        future = getattr(self._parameters, request)(*arguments)
        self.spin_until(future.done, f"an answer of {request}")
        return future.result()

    # Waiting

    def spin_for(self, duration_s):
        """Handles what comes, as long as the pause of a lidar between two sweeps lasts."""
        end = time.monotonic() + duration_s
        while (rest_s := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=rest_s)

    def spin_some(self):
        """Handles one thing that has come, if there is one."""
        self._executor.spin_once(timeout_sec=0)

    def spin_until(self, condition, what):
        """Handles what comes until the condition is true; returns what it returned."""
        give_up = time.monotonic() + PATIENCE_S
        while not (result := condition()):
            assert self.process.is_running, f"{what}: the node has ended\n{self.process.log}"
            assert time.monotonic() < give_up, (
                f"{what}: not within {PATIENCE_S} s; {self.values('input')}, {self.values('flow')}"
            )
            self._executor.spin_once(timeout_sec=0.02)
        return result

    def wait_for_node(self, reliability=None):
        """Waits until the node listens to this peer, as reliably as it should."""
        policy = self._publisher.qos_profile.reliability
        offered = "reliable" if policy == ReliabilityPolicy.RELIABLE else "best_effort"
        expected = {"publishers": "1", "reliability": reliability or offered}
        self.spin_until(
            lambda: expected.items() <= self.values("input").items(), f"a subscription {expected}"
        )
        self.wait_for_subscription(expected["reliability"])

    def wait_for_subscription(self, reliability):
        """Waits until the publisher of this peer sees the subscription of the node, and no other.

        One that the node has just replaced is still seen for a moment.
        """

        def is_seen():
            seen = self.node.get_subscriptions_info_by_topic(self.points_topic)
            names = [info.qos_profile.reliability.name.lower() for info in seen]
            return names == [reliability] and self.num_subscribers == 1

        self.spin_until(is_seen, f"a {reliability} subscription")

    def wait_until_settled(self):
        """Waits until the node has done all it can with what it has got."""
        self.wait_for_diagnostics()
        self.spin_until(
            lambda: self.num_open_triplets == 0 and self.values("flow")["busy"] == "False",
            "the end of all estimates",
        )

    def wait_for_diagnostics(self):
        """Waits for new diagnostics: one was received already, one more was under way."""
        wanted = len(self.diagnostics) + 3
        self.spin_until(lambda: len(self.diagnostics) >= wanted, "further diagnostics")

    def call_without_waiting(self, service, name, request):
        """Calls a service of the node that may never answer."""
        self._client(service, name).call_async(request)

    def _client(self, service, name):
        if name not in self._clients:
            self._clients[name] = self.node.create_client(service, f"{self._node_name}/{name}")
        self.spin_until(self._clients[name].service_is_ready, f"the service {name}")
        return self._clients[name]

    def call(self, service, name, request):
        """Calls a service of the node; the response."""
        future = self._client(service, name).call_async(request)
        self.spin_until(future.done, f"an answer of {name}")
        return future.result()

    def _on_flow(self, message):
        self.flows[stamp_of(message)] = message

    def _on_diagnostics(self, message):
        own_name = self._node_name.lstrip("/")
        own = {
            part: status
            for status in message.status
            for name, _, part in [status.name.rpartition(": ")]
            if name == own_name
        }
        if own:
            own["header"] = message.header
            self.diagnostics.append(own)


def _parameters(changes):
    """Parameters as they are sent; a value may be a ParameterValue with any contents."""
    return [
        ParameterMessage(name=name, value=value)
        if isinstance(value, ParameterValue)
        else Parameter(name, value=value)
        for name, value in changes.items()
    ]


def stamp_of(message):
    """Stamp of a message, nanoseconds."""
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
