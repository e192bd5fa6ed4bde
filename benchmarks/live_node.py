# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The node in a process of its own, fed with serialized clouds over DDS."""

import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from drives import INTERVAL_NS
from std_msgs.msg import Header

from mnsf_ros.node.environment import prepare_environment
from mnsf_ros.node.raw_topics import RawTopics, message_class
from mnsf_ros.stream.pipeline import TRIPLET_ENDS
from mnsf_ros.sweeps.sweep import Sweep
from msg_utils.cdr import serialized_cloud
from msg_utils.other_clouds import CLOUD_TYPE
from msg_utils.point_cloud2 import encode_columns

FIRST_NS: Final = 10**18
_FLOW_TOPIC: Final = "/scene_flow/flow"
_START_TIMEOUT_S: Final = 120
_SETTLE_TIMEOUT_S: Final = 60
_STOP_TIMEOUT_S: Final = 10
_REMAPPED: Final = ("-r", "~/points:=/points")
_STATUSES: Final = "diagnostic_msgs/msg/DiagnosticArray"
# After so many messages on /diagnostics without any change nothing more is expected.
_QUIET_STATUSES: Final = 5
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
    encoding = encode_columns(columns, 1, len(sweep))
    return bytearray(serialized_cloud(Header(frame_id="lidar"), encoding, is_dense=True))


class LiveNode(RawTopics):
    """A running node, and the robot's side of it: publishes clouds, receives flow and diagnostics.

    Attributes:
        process: Its process.
        log: File with the output of the process.
        points: Publisher of its clouds.
        num_published: Number of clouds published, good or not.
        published_s: Stamp of a good sweep -> `time.monotonic()` of its publication, in that order.
        arrived_s: Stamp of a good sweep -> `time.monotonic()` of the arrival of its flow.
        counts: Event -> number, as counted in the latest message on /diagnostics.
        values: Key -> value of the latest `flow` status there.
        start_s: Time from the start of the process until it and this one saw each other.
    """

    def __init__(self, parameters: Sequence[str], file: Path | None, log: Path) -> None:
        """Starts the process, which ends with the `with` block."""
        super().__init__("mnsf_replay")
        self.log, self.num_published, self.start_s = log, 0, 0.0
        self._num_statuses = 0
        self.points = self.publisher("/points", CLOUD_TYPE)
        self.published_s: dict[int, float] = {}
        self.arrived_s: dict[int, float] = {}
        self.counts: dict[str, int] = {}
        self.values: dict[str, str] = {}
        self.subscribe("/diagnostics", _STATUSES, self._receive_diagnostics)
        # Serialized: to read it would cost more than to receive it.
        kind = message_class(CLOUD_TYPE)
        self.node.create_subscription(kind, _FLOW_TOPIC, self._receive_flow, 5, raw=True)
        words = ["--params-file", str(file)] if file else []
        words += [word for parameter in parameters for word in ("-p", parameter)]
        command = [sys.executable, "-m", "mnsf_ros.node", "--ros-args", *_REMAPPED, *words]
        with log.open("wb") as out:
            self.process = subprocess.Popen(command, stdout=out, stderr=out, start_new_session=True)
        self._proc = Path("/proc", str(self.process.pid))

    def __exit__(self, *error: object) -> None:
        self.process.send_signal(signal.SIGINT)  # does nothing if it has ended
        try:
            self.process.wait(_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
        super().__exit__(*error)

    @property
    def num_good(self) -> int:
        """Number of good sweeps published."""
        return len(self.published_s)

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

    def state(self) -> dict[str, float]:
        """Memory (MB), and numbers of descriptors, threads and shared segments of the process."""
        maps = (line.split() for line in (self._proc / "maps").read_text().splitlines())
        return {
            "MB": self.memory_mb(),
            "descriptors": len(list((self._proc / "fd").iterdir())),
            "threads": len(list((self._proc / "task").iterdir())),
            "segments": len({words[-1] for words in maps if words[-1].startswith("/dev/shm")}),
        }

    def check(self) -> None:
        """Raises a RuntimeError if the node has ended."""
        if (status := self.process.poll()) is not None:
            raise self._failure(f"the node ended with exit status {status}")

    def publish(self, raw: bytearray, interval_ns: int = INTERVAL_NS) -> None:
        """Publishes a good sweep with the next stamp."""
        stamp_ns = FIRST_NS + self.num_good * interval_ns
        stamped, published_s = with_stamp(raw, stamp_ns), time.monotonic()
        self.points.publish(stamped)
        self.published_s[stamp_ns] = published_s
        self.num_published += 1

    def start(self) -> None:
        """Waits until the node and this process see each other; to be called once and first."""
        begin_s = time.monotonic()

        def is_there() -> bool:
            # Diagnostics arrive once the node sees this process.
            is_seen = self.node.count_publishers(_FLOW_TOPIC) > 0 < self._num_statuses
            return self.points.get_subscription_count() > 0 and is_seen

        if not self._wait_until(is_there, _START_TIMEOUT_S):
            raise self._failure(f"no node after {_START_TIMEOUT_S} s")
        self.start_s = time.monotonic() - begin_s

    def settle(self) -> None:
        """Waits until the node is idle, and some messages on /diagnostics tell nothing new."""
        last, num_before = None, 0

        def is_settled() -> bool:
            nonlocal last, num_before
            now = (self.counts, len(self.arrived_s))
            if now != last:
                last, num_before = now, self._num_statuses
            is_quiet = self._num_statuses - num_before >= _QUIET_STATUSES
            return is_quiet and self.values.get("busy") == "False"

        self._wait_until(is_settled, _SETTLE_TIMEOUT_S)

    def balance(self) -> Iterator[tuple[str, str, bool]]:
        """Whether every cloud and every triplet is accounted for, as figures of a promise."""
        counted = sum(self.counts.get(event, 0) for event in _CLOUD_EVENTS)
        text = f"{counted:,} of {self.num_published:,}"
        yield "clouds counted", text, counted == self.num_published
        formed = self.counts.get("triplets_formed", 0)
        ended = sum(self.counts.get(event, 0) for event in TRIPLET_ENDS)
        yield "triplets ended", f"{ended:,} of {formed:,}", ended == formed
        tracebacks = self.log.read_text(errors="replace").count("Traceback")
        yield "tracebacks in the log", str(tracebacks), tracebacks == 0

    def _wait_until(self, is_done: Callable[[], bool], timeout_s: float) -> bool:
        deadline_s = time.monotonic() + timeout_s
        while not is_done():
            self.check()
            if time.monotonic() > deadline_s:
                return False
            self.spin_for(0.1)
        return True

    def _failure(self, what: str) -> RuntimeError:
        lines = self.log.read_text(errors="replace").strip().splitlines()[-5:]
        return RuntimeError(f"{what}; it said: {' | '.join(lines) or 'nothing'} ({self.log})")

    def _receive_flow(self, raw: bytes) -> None:
        sec, nanosec = struct.unpack_from("<iI", raw, _STAMP_AT)
        if (stamp_ns := sec * 10**9 + nanosec) in self.published_s:
            self.arrived_s[stamp_ns] = time.monotonic()

    def _receive_diagnostics(self, message: DiagnosticArray) -> None:
        values = {
            status.name.rpartition(": ")[2]: {item.key: item.value for item in status.values}
            for status in message.status
        }
        if "flow" in values:
            self._num_statuses += 1
            self.values = values["flow"]
            told = chain.from_iterable(one.items() for one in values.values())
            self.counts = {
                key: int(value) for key, value in told if value.isdigit() and " " not in key
            }


@contextmanager
def live_node(*parameters: str, file: Path | None = None) -> Iterator[LiveNode]:
    """Starts a node with parameters such as `node.always_estimate:=true` and waits for it.

    `file` has further parameters, as those in config/.
    """
    prepare_environment()
    with (
        tempfile.TemporaryDirectory() as folder,
        LiveNode(parameters, file, Path(folder, "node.log")) as node,
    ):
        node.start()
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
