# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The node in a process of its own, fed with serialized clouds over DDS."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

import numpy as np
from drives import INTERVAL_NS
from std_msgs.msg import Header

from mnsf_ros.demo.node_process import NodeProcess, node_process
from mnsf_ros.demo.replay import ReplayLink
from mnsf_ros.node.environment import prepare_environment
from mnsf_ros.online.online_pipeline import TRIPLET_ENDS
from mnsf_ros.sweeps.sweep import Sweep
from msg_utils.cdr import serialized_cloud
from msg_utils.point_cloud2 import encoding_of_columns

FLOW_TOPIC: Final = "/scene_flow/flow"
FIRST_NS: Final = 10**18
_START_TIMEOUT_S: Final = 120
_SETTLE_TIMEOUT_S: Final = 60
# The node counts each published cloud as one of these; the transport's losses are among the missed.
_CLOUD_EVENTS: Final = ("sweeps_received", "clouds_undecodable", "clouds_empty", "clouds_missed")
# In a serialized message four bytes name the encoding, then the stamp comes.
_STAMP_AT: Final = 4


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
