# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The scene flow node in its own process, and its other end: lidar, listener, parameter client."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2

from mnsf_ros.stream.pipeline import TRIPLET_ENDS

# Far more than a loaded machine needs: only a failing test waits that long.
PATIENCE_S = 120.0

# No cloud may be overwritten while a test does something else.
_DEPTH = 500

# Each cloud that a node receives is counted as one of these.
_CLOUD_EVENTS = ("sweeps_received", "clouds_undecodable", "clouds_empty")

_CHECKOUT = Path(__file__).resolve().parents[2]

# The default but for ground, which the clouds of the tests have none of: an estimate of some 30 ms.
QUICK = {
    "ground.remove": "false",
    "compute.num_threads": 1,
    "compute.device": "cpu",
    "node.diagnostics_period_s": 0.05,
    "node.always_estimate": "true",
    # However long a slow machine makes the pauses between two sweeps.
    "node.stale_after_s": 60.0,
}

# An estimate that takes minutes on any machine, in many short steps.
ENDLESS = QUICK | {
    "method.name": "mnsf",
    "field.num_hidden_layers": 2,
    "optimization.max_iterations": 100_000,
    "optimization.time_budget_ms": 0,
}

# An estimate that is most of its time inside one library call, which takes a second or more.
LONG_CALLS = ENDLESS | {"distance.kind": "grid", "distance.cell_size_m": 0.06}

# What the process of the tests has set for itself, and the node has to set on its own.
PREPARED = (
    *("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"),
    *("RMW_FASTRTPS_USE_QOS_FROM_XML", "OMP_WAIT_POLICY", "OPENBLAS_NUM_THREADS"),
)

# As the executable scene_flow_lifecycle_node does.
_LIFE_CYCLE = "from mnsf_ros.node.__main__ import lifecycle_main; lifecycle_main()"


class SceneFlowProcess:
    """`python -m mnsf_ros.node`, or the node with a life cycle; it writes to a file."""

    def __init__(self, log_path, parameters, ros_arguments, *, has_life_cycle=False):
        self._log_path = log_path
        words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
        program = ["-c", _LIFE_CYCLE] if has_life_cycle else ["-m", "mnsf_ros.node"]
        with log_path.open("w") as log:
            self._process = subprocess.Popen(
                [sys.executable, *program, "--ros-args", *ros_arguments, *words],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                cwd=_CHECKOUT,
                env={name: value for name, value in os.environ.items() if name not in PREPARED}
                | {"PYTHONFAULTHANDLER": "1"},
            )
        self.send_signal = self._process.send_signal

    @property
    def log(self):
        """Output of the node so far."""
        return self._log_path.read_text()

    @property
    def fatal(self):
        """The only line of a fatal error."""
        (line,) = (line for line in self.log.splitlines() if "[FATAL]" in line)
        return line

    @property
    def is_running(self):
        return self._process.poll() is None

    def has_loaded(self, library):
        """Whether a shared library of that name is in the memory of the process."""
        return library in Path(f"/proc/{self._process.pid}/maps").read_text()

    def wait(self):
        """Exit status, once the process has ended by itself."""
        try:
            return self._process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            # All its threads write where they are.
            self.send_signal(signal.SIGABRT)
            self._process.wait()
            raise AssertionError(self.log) from None

    def end(self):
        """Ends the process if it still runs, whatever state it is in."""
        if self.is_running:
            self._process.terminate()
            try:
                self._process.wait(5)
            except subprocess.TimeoutExpired:
                self._process.kill()
        self._process.wait()


class Spinner:
    """A ROS node of the tests that handles what comes while a test waits."""

    def __init__(self, name):
        self.node = rclpy.create_node(name)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()

    def spin_for(self, duration_s):
        """Handles what comes, as long as the pause of a lidar between two sweeps lasts."""
        end = time.monotonic() + duration_s
        while (rest_s := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=rest_s)

    def spin_until(self, condition, what):
        """Handles what comes until the condition is true; returns what it returned."""
        give_up = time.monotonic() + PATIENCE_S
        while not (result := condition()):
            self.check(what)
            assert time.monotonic() < give_up, f"{what}: not within {PATIENCE_S} s; {self.state}"
            self._executor.spin_once(timeout_sec=0.02)
        return result

    def check(self, what):
        """Fails if waiting makes no sense any more."""

    state = ""


class SceneFlowPeer(Spinner):
    """Publishes clouds, receives flow and diagnostics, sets parameters; spins while it waits.

    Attributes:
        process: The node.
        flows: Received clouds with flow by their stamp, nanoseconds.
        diagnostics: Received diagnostics of the node, oldest first: `input` and `flow` to status.
    """

    def __init__(self, process, node_name, *, watches=True, reliable=True, points=None):
        super().__init__(f"peer_of{node_name.replace('/', '_')}")
        self.process = process
        self._node_name = node_name
        self.points_topic = points or f"{node_name}/points"
        self.flow_topic = f"{node_name}/flow"
        self._clients = {}
        self._parameters = AsyncParameterClient(self.node, node_name)
        self._publisher = None
        self._flow_subscription = None
        self.flows = {}
        self.diagnostics = []
        # Of diagnostics only the newest: old ones would be taken for what is true now.
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 1)
        self.advertise(reliable=reliable)
        if watches:
            self.watch()

    # Clouds and flow

    def advertise(self, *, reliable):
        """Starts to publish clouds; the last publisher ends."""
        self.stop_advertising()
        self._publisher = self.node.create_publisher(PointCloud2, self.points_topic, _qos(reliable))

    def stop_advertising(self):
        if self._publisher is not None:
            self.node.destroy_publisher(self._publisher)
        self._publisher = None

    def watch(self, *, reliable=True):
        """Subscribes to the flow."""
        self._flow_subscription = self.node.create_subscription(
            PointCloud2, self.flow_topic, self._on_flow, _qos(reliable)
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

    def flow_amid(self, sweeps):
        """Sends sweeps; the flow of the second one."""
        self.send(*sweeps)
        return self.flow_of(sweeps[1])

    @property
    def num_subscribers(self):
        """Subscriptions that the publisher of this peer knows of."""
        return self._publisher.get_subscription_count()

    def names_and_types(self, names_of):
        """Topics or services of the node, by a function of rclpy.node.Node, as far as known."""
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
        """Count of an event in the newest diagnostics."""
        return int((self.values("input") | self.values("flow")).get(event, 0))

    def values(self, part):
        """Key to value of the newest diagnostics of `input` or `flow`."""
        status = self.status(part)
        return {item.key: item.value for item in status.values} if status else {}

    def status(self, part):
        """The newest status of `input` or `flow`, None if there was none yet."""
        return self.diagnostics[-1][part] if self.diagnostics else None

    # Parameters and services

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

    def call(self, service, name, request):
        """Response of a service of the node."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(service, f"{self._node_name}/{name}")
        self.spin_until(self._clients[name].service_is_ready, f"the service {name}")
        future = self._clients[name].call_async(request)
        self.spin_until(future.done, f"an answer of {name}")
        return future.result()

    # Waiting

    def check(self, what):
        """Fails if the node has ended."""
        assert self.process.is_running, f"{what}: the node has ended\n{self.process.log}"

    @property
    def state(self):
        """The newest diagnostics."""
        return f"{self.values('input')}, {self.values('flow')}"

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

    def _on_flow(self, message):
        self.flows[stamp_of(message)] = message

    def _on_diagnostics(self, message):
        names = [status.name.rpartition(": ") for status in message.status]
        own = {
            part: status
            for status, (name, _, part) in zip(message.status, names, strict=True)
            if name == self._node_name.lstrip("/")
        }
        if own:
            self.diagnostics.append(own | {"message": message})


def _qos(reliable):
    policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(depth=_DEPTH, reliability=policy)


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
