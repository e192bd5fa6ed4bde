"""The other end of the scene flow node: a lidar, a listener and a parameter client in one."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rcl_interfaces.srv import SetParametersAtomically
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from waiting import PATIENCE_S

_DEPTH = 200


def parameter_message(name, value):
    """A parameter as it is sent; `value` may be a ParameterValue of any contents."""
    if isinstance(value, ParameterValue):
        return ParameterMessage(name=name, value=value)
    return Parameter(name, value=value).to_parameter_msg()


class SceneFlowPeer:
    """Publishes clouds, receives flow and diagnostics, sets parameters. Spins in the tests' thread.

    Attributes:
        flows: Received flow clouds by their stamp, nanoseconds.
        diagnostics: Received diagnostics, oldest first.
    """

    def __init__(self, node_name="/scene_flow", *, watches=True, reliable=True):
        self.node = rclpy.create_node("scene_flow_peer")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._name = node_name
        self._clients = {}
        self.flows = {}
        self.diagnostics = []
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, _DEPTH)
        self.publisher = None
        if reliable is not None:
            self.advertise(reliable=reliable)
        self._flow_subscription = None
        if watches:
            self.watch()

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()

    def advertise(self, *, reliable):
        """Starts to publish clouds, with a publisher of its own reliability."""
        self.stop_advertising()
        policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        self.publisher = self.node.create_publisher(
            PointCloud2, f"{self._name}/points", QoSProfile(depth=_DEPTH, reliability=policy)
        )

    def stop_advertising(self):
        if self.publisher is not None:
            self.node.destroy_publisher(self.publisher)
        self.publisher = None

    def watch(self):
        """Subscribes to the flow."""
        self._flow_subscription = self.node.create_subscription(
            PointCloud2, f"{self._name}/flow", self._on_flow, _DEPTH
        )

    def stop_watching(self):
        self.node.destroy_subscription(self._flow_subscription)

    def spin(self):
        """Handles what has come, or waits a little for the next thing."""
        self._executor.spin_once(timeout_sec=0.02)

    def spin_until(self, condition, what):
        """Spins until the condition is true and returns what it returned."""
        give_up = time.monotonic() + PATIENCE_S
        while not (result := condition()):
            assert time.monotonic() < give_up, f"waited {PATIENCE_S} s for {what}; {self.statuses()}"
            self.spin()
        return result

    def wait_for_node(self):
        """Waits until the node hears the clouds of this peer as reliably as they are sent."""

        def is_connected():
            values = self.values("input")
            return values.get("publishers") == "1" and values.get("reliability") == self.reliability

        self.spin_until(is_connected, "the node's subscription")

    @property
    def reliability(self):
        policy = self.publisher.qos_profile.reliability
        return "reliable" if policy == ReliabilityPolicy.RELIABLE else "best_effort"

    def send(self, message):
        """Publishes a cloud and waits until the node has counted it, one way or the other."""
        before = self.num_clouds()
        self.publisher.publish(message)
        self.spin_until(lambda: self.num_clouds() > before, "the cloud to be counted")

    def num_clouds(self):
        """Clouds that the node says it has received."""
        kinds = ("sweeps_received", "clouds_undecodable", "clouds_empty")
        return sum(self.count(kind) for kind in kinds)

    def count(self, event):
        """How often the event has happened, as the newest diagnostics say."""
        return int((self.values("input") | self.values("flow")).get(event, 0))

    def values(self, part):
        """Key to value of the newest diagnostics of `input` or `flow`."""
        status = self.statuses().get(part)
        return {item.key: item.value for item in status.values} if status else {}

    def statuses(self):
        """`input` and `flow` to the newest status of that name."""
        newest = self.diagnostics[-1].status if self.diagnostics else ()
        return {status.name.rpartition(": ")[2]: status for status in newest}

    def flow_of(self, message):
        """The flow of a cloud, once it has come."""
        stamp_ns = stamp_of(message)
        return self.spin_until(lambda: self.flows.get(stamp_ns), f"the flow of {stamp_ns}")

    def set(self, changes):
        """Sets parameters one by one; the results in their order."""
        request = SetParameters.Request()
        request.parameters = [parameter_message(*item) for item in changes.items()]
        return self._call(SetParameters, "set_parameters", request).results

    def set_atomically(self, changes):
        """Sets parameters all at once or not at all; the result."""
        request = SetParametersAtomically.Request()
        request.parameters = [parameter_message(*item) for item in changes.items()]
        return self._call(SetParametersAtomically, "set_parameters_atomically", request).result

    def get(self, name):
        """Value of a parameter."""
        request = GetParameters.Request(names=[name])
        values = self._call(GetParameters, "get_parameters", request).values
        return Parameter.from_parameter_msg(ParameterMessage(name=name, value=values[0])).value

    def describe(self, name):
        request = DescribeParameters.Request(names=[name])
        return self._call(DescribeParameters, "describe_parameters", request).descriptors[0]

    def _call(self, service, name, request):
        if name not in self._clients:
            self._clients[name] = self.node.create_client(service, f"{self._name}/{name}")
        client = self._clients[name]
        self.spin_until(client.service_is_ready, f"the service {name}")
        future = client.call_async(request)
        self.spin_until(future.done, f"an answer of {name}")
        return future.result()

    def _on_flow(self, message):
        self.flows[stamp_of(message)] = message

    def _on_diagnostics(self, message):
        self.diagnostics.append(message)


def stamp_of(message):
    """Stamp of a message, nanoseconds."""
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
