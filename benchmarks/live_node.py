# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The node in a process of its own, fed with serialized clouds over DDS."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from drives import INTERVAL_NS
from rclpy.serialization import deserialize_message
from std_msgs.msg import Header

from mnsf_ros.node.environment import prepare_environment
from mnsf_ros.node.raw_topics import RawTopics
from mnsf_ros.online.online_pipeline import TRIPLET_ENDS
from mnsf_ros.recording.bag_topics import CLOUD_TYPE
from mnsf_ros.sweeps.sweep import Sweep
from msg_utils.cdr import serialized_cloud
from msg_utils.point_cloud2 import encoding_of_columns

FLOW_TOPIC: Final = "/scene_flow/flow"
FIRST_NS: Final = 10**18
_START_TIMEOUT_S: Final = 120
_SETTLE_TIMEOUT_S: Final = 60
_STOP_TIMEOUT_S: Final = 10
_STATUSES: Final = "diagnostic_msgs/msg/DiagnosticArray"
# After so many messages on /diagnostics without any change nothing more is expected.
_QUIET_STATUSES: Final = 5
# The node counts each published cloud as one of these; the transport's losses are among the missed.
_CLOUD_EVENTS: Final = ("sweeps_received", "clouds_undecodable", "clouds_empty", "clouds_missed")
# In a serialized message four bytes name the encoding, then the stamp comes.
_STAMP_AT: Final = 4


def stamp_of(raw: bytes) -> int:
    """Returns the stamp of a serialized cloud, nanoseconds."""
    sec, nanosec = struct.unpack_from("<iI", raw, _STAMP_AT)
    return int(sec * 10**9 + nanosec)


def with_stamp(raw: bytearray, stamp_ns: int) -> bytes:
    """Returns a serialized cloud with another stamp."""
    struct.pack_into("<iI", raw, _STAMP_AT, *divmod(stamp_ns, 10**9))
    return bytes(raw)


def serialized(sweep: Sweep) -> bytearray:
    """Returns the serialized message of a sweep, with an intensity."""
    columns = {axis: np.ascontiguousarray(sweep.xyz[:, i]) for i, axis in enumerate("xyz")}
    columns["intensity"] = np.zeros(len(sweep), np.float32)
    encoding = encoding_of_columns(columns, 1, len(sweep))
    return bytearray(serialized_cloud(Header(frame_id="lidar"), encoding, is_dense=True))


@dataclass
class ReplayLog:
    """Sweeps and flows of a replay, and the node's own figures.

    Attributes:
        published_s: Stamp of a sweep -> `time.monotonic()` of its publication, in that order.
        arrived_s: Stamp of a sweep -> `time.monotonic()` of the arrival of its flow.
        counts: Event -> number, as counted in the latest message on /diagnostics.
        values: Key -> value of the latest `flow` status there.
    """

    published_s: dict[int, float] = field(default_factory=dict)
    arrived_s: dict[int, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    values: dict[str, str] = field(default_factory=dict)


class ReplayLink(RawTopics):
    """The robot's side of a node: publishes sweeps, receives flow and diagnostics."""

    def __init__(self, points_topic: str, flow_topic: str) -> None:
        super().__init__("mnsf_replay")
        self.log = ReplayLog()
        self.points = self.publisher(points_topic, CLOUD_TYPE)
        self._flow_topic, self._num_statuses = flow_topic, 0
        self.subscribe(flow_topic, CLOUD_TYPE, self._receive_flow)
        self.subscribe("/diagnostics", _STATUSES, self._receive_diagnostics, depth=10)

    @property
    def is_heard(self) -> bool:
        """Whether the node subscribes to the sweeps."""
        return self.points.get_subscription_count() > 0

    @property
    def is_connected(self) -> bool:
        """Whether the node and this process see each other; its diagnostics arrive once it does."""
        return self.is_heard and self.num_publishers(self._flow_topic) > 0 < self._num_statuses

    def publish(self, raw: bytes) -> None:
        """Publishes a serialized cloud."""
        published_s = time.monotonic()
        self.points.publish(raw)
        self.log.published_s[stamp_of(raw)] = published_s

    def wait_until(self, is_done: Callable[[], bool], node: NodeProcess, timeout_s: float) -> bool:
        """Handles messages until something is done; False if it is not done in time."""
        deadline_s = time.monotonic() + timeout_s
        while not is_done():
            node.check()
            if time.monotonic() > deadline_s:
                return False
            self.spin_for(0.1)
        return True

    def settle(self, node: NodeProcess, timeout_s: float) -> None:
        """Waits until the node is idle, and some messages on /diagnostics tell nothing new."""
        last, num_before = None, 0

        def is_settled() -> bool:
            nonlocal last, num_before
            now = (self.log.counts, len(self.log.arrived_s))
            if now != last:
                last, num_before = now, self._num_statuses
            is_quiet = self._num_statuses - num_before >= _QUIET_STATUSES
            return is_quiet and self.log.values.get("busy") == "False"

        self.wait_until(is_settled, node, timeout_s)

    def _receive_flow(self, raw: bytes) -> None:
        stamp_ns = stamp_of(raw)
        if stamp_ns in self.log.published_s:
            self.log.arrived_s[stamp_ns] = time.monotonic()

    def _receive_diagnostics(self, raw: bytes) -> None:
        message = deserialize_message(raw, DiagnosticArray)
        values = {
            status.name.rpartition(": ")[2]: {item.key: item.value for item in status.values}
            for status in message.status
        }
        if "flow" in values:
            self._num_statuses += 1
            self.log.values = values["flow"]
            told = chain.from_iterable(one.items() for one in values.values())
            self.log.counts = {
                key: int(value) for key, value in told if value.isdigit() and " " not in key
            }


class NodeProcess:
    """A running node."""

    def __init__(self, process: subprocess.Popen[bytes], log: Path) -> None:
        self.pid, self._process, self._log = process.pid, process, log

    def check(self) -> None:
        """Raises a RuntimeError if the node has ended."""
        if (status := self._process.poll()) is not None:
            raise self.failure(f"the node ended with exit status {status}")

    def failure(self, what: str) -> RuntimeError:
        """An error with the last lines of the node's log."""
        lines = self._log.read_text(errors="replace").strip().splitlines()[-5:]
        return RuntimeError(f"{what}; it said: {' | '.join(lines) or 'nothing'} ({self._log})")


@contextmanager
def node_process(arguments: Sequence[str], log: Path) -> Iterator[NodeProcess]:
    """Runs the node with arguments after `--ros-args`; its log goes into a file."""
    command = [sys.executable, "-m", "mnsf_ros.node", "--ros-args", *arguments]
    with (
        log.open("wb") as stream,
        subprocess.Popen(command, stdout=stream, stderr=stream, start_new_session=True) as process,
    ):
        try:
            yield NodeProcess(process, log)
        finally:
            process.send_signal(signal.SIGINT)  # does nothing if it has ended
            try:
                process.wait(_STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()


class LiveNode:
    """A running node, a publisher of its clouds and a subscriber of its flow.

    Attributes:
        process: The process.
        link: The other end of its topics.
        log: File with the output of the process.
        replay: Times of publication of good sweeps, and of arrival of their flow.
        num_published: Number of clouds published, good or not.
        start_s: Time from the start of the process to its subscription.
    """

    def __init__(self, process: NodeProcess, link: ReplayLink, log: Path) -> None:
        self.process = process
        self.link = link
        self.log = log
        self.replay = link.log
        self.num_published = 0
        self.start_s = 0.0
        self._proc = Path("/proc", str(process.pid))

    @property
    def num_good(self) -> int:
        """Number of good sweeps published."""
        return len(self.replay.published_s)

    @property
    def num_ended(self) -> int:
        """Number of triplets that the node has dealt with, by its last diagnostics."""
        return sum(self.link.log.counts.get(event, 0) for event in TRIPLET_ENDS)

    @property
    def cpu_s(self) -> float:
        """CPU time of all threads of the process so far."""
        # The name before the last bracket may have spaces in it.
        words = (self._proc / "stat").read_text().rpartition(")")[2].split()
        return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")

    def memory_mb(self, kind: str = "VmRSS") -> float:
        """Memory of the process now; its peak with `VmHWM`."""
        lines = (self._proc / "status").read_text().splitlines()
        return next(float(line.split()[1]) / 1e3 for line in lines if line.startswith(kind))

    def publish(self, raw: bytearray, interval_ns: int = INTERVAL_NS) -> None:
        """Publishes a good sweep with the next stamp."""
        stamped = with_stamp(raw, FIRST_NS + self.num_good * interval_ns)
        self.link.publish(stamped)
        self.num_published += 1

    def settle(self) -> None:
        """Waits until the node is idle and its counts do not change any more."""
        self.link.settle(self.process, _SETTLE_TIMEOUT_S)

    def state(self) -> dict[str, float]:
        """Memory (MB), and numbers of descriptors, threads and shared segments of the process."""
        maps = (line.split() for line in (self._proc / "maps").read_text().splitlines())
        return {
            "MB": self.memory_mb(),
            "descriptors": len(list((self._proc / "fd").iterdir())),
            "threads": len(list((self._proc / "task").iterdir())),
            "segments": len({words[-1] for words in maps if words[-1].startswith("/dev/shm")}),
        }

    def balance(self) -> Iterator[tuple[str, str, bool]]:
        """Whether every cloud and every triplet is accounted for, as figures of a promise."""
        counts = self.link.log.counts
        counted = sum(counts.get(event, 0) for event in _CLOUD_EVENTS)
        text = f"{counted:,} of {self.num_published:,}"
        yield "clouds counted", text, counted == self.num_published
        formed = counts.get("triplets_formed", 0)
        yield "triplets ended", f"{self.num_ended:,} of {formed:,}", self.num_ended == formed
        tracebacks = self.log.read_text(errors="replace").count("Traceback")
        yield "tracebacks in the log", str(tracebacks), tracebacks == 0


@contextmanager
def live_node(*parameters: str, flow_topic: str | None = FLOW_TOPIC) -> Iterator[LiveNode]:
    """Starts a node with parameters such as `node.always_estimate:=true` and waits for it.

    Without a `flow_topic` nothing of the node is subscribed to but its diagnostics.
    """
    prepare_environment()
    words = [word for parameter in parameters for word in ("-p", parameter)]
    with ExitStack() as stack:
        log = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "node.log"
        link = ReplayLink("/points", flow_topic or "/nothing")
        stack.enter_context(link)
        start_s = time.monotonic()
        process = stack.enter_context(node_process(["-r", "~/points:=/points", *words], log))
        node = LiveNode(process, link, log)
        is_there = (lambda: link.is_connected) if flow_topic else (lambda: link.is_heard)
        if not link.wait_until(is_there, process, _START_TIMEOUT_S):
            raise process.failure(f"no node after {_START_TIMEOUT_S} s")
        node.start_s = time.monotonic() - start_s
        yield node


@contextmanager
def busy_cores(number: int) -> Iterator[None]:
    """Keeps some cores busy with endless loops."""
    command = [sys.executable, "-c", "while True: pass"]
    processes = [subprocess.Popen(command) for _ in range(number)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()
