# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Promises of the running node for `reliability.py`: kills, clouds, overload, soak."""

from __future__ import annotations

import itertools
import math
import multiprocessing
import os
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import numpy as np
from hostile_clouds import KINDS, hostile
from online_live import FIRST_NS, LiveNode, busy_cores, live_node, serialized, with_stamp
from online_recordings import INTERVAL_NS, simulated_sweeps, to_and_fro
from promises import Figure, Promise, Rounds, fates
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64

from mnsf_ros.demo.node_process import node_process
from mnsf_ros.node.environment import prepare_environment, remove_dead_segments
from mnsf_ros.node.process_memory import RETURN_PERIOD_S
from mnsf_ros.node.replay_link import ReplayLink
from mnsf_ros.sweeps.sweep import Sweep

# On a busy machine a node takes a minute to start.
_FLOW_TIMEOUT_S: Final = 300
_NODE_START_S: Final = 4.0
_OLD_S: Final = 61
# Two segments.
_MAX_SHARED_MB: Final = 53
_HUGE: Final = 2_000_000
_MAX_KEPT_MB: Final = 100
# At 10 Hz.
_NUM_AFTER: Final = round(2 * RETURN_PERIOD_S * 10)
_PAUSE_S: Final = 0.02
_LOOK_S: Final = 10
_WARM_UP_MIN: Final = 10
_MAX_GROWTH_MB: Final = 20
# Otherwise the machine was not overloaded.
_MIN_DROPPED: Final = 0.1
OFTEN: Final = "node.diagnostics_period_s:=0.2"


def _clouds(**settings: int) -> Iterator[bytearray]:
    """Serialized sweeps of a simulated street, to and fro without end.

    At a walk: at the usual speed the registration would take a wrong place after each turn.
    """
    drive = simulated_sweeps(0, 24, ego_speed_m_s=2, **settings)
    return itertools.cycle(to_and_fro(serialized(item.sweep) for item in drive))


class _Growth:
    """What the process of a node holds, looked at every ten seconds."""

    def __init__(self, node: LiveNode) -> None:
        self._node = node
        self._start_s = time.monotonic()
        self._states: list[dict[str, float]] = []

    def look(self) -> None:
        """To be called again and again."""
        if time.monotonic() - self._start_s > _LOOK_S * (len(self._states) + 1):
            self._states.append(self._node.state())

    def figures(self) -> Iterator[Figure]:
        """See `growth`."""
        return growth([*self._states, self._node.state()])


def growth(states: Sequence[Mapping[str, float]]) -> Iterator[Figure]:
    """Whether memory, descriptors, threads and segments are at last more than at first.

    The most of each of two spans of equal length: memory goes up and down with what the threads of
    the node happen to need at the same time.
    """
    # Of a short run, the first third.
    span = max(1, min(60 * _WARM_UP_MIN // _LOOK_S, len(states) // 3))
    early, late = (
        {name: max(state[name] for state in part) for name in states[0]}
        for part in (states[:span], states[-span:])
    )
    spans = f"at most in the first and the last {span * _LOOK_S / 60:.1f} min"
    text = f"{early['MB']:.0f} -> {late['MB']:.0f} MB, {spans}"
    yield "memory", text, late["MB"] - early["MB"] <= _MAX_GROWTH_MB
    for name in ("descriptors", "threads", "segments"):
        yield name, f"{early[name]:.0f} -> {late[name]:.0f}", late[name] <= early[name]


def soak(rounds: Rounds) -> Iterator[Figure]:
    """Full sweeps at 10 Hz: memory, descriptors, threads and segments stay what they are."""
    with live_node(OFTEN) as node:
        clouds, start_s, growth = _clouds(), time.monotonic(), _Growth(node)
        for _ in rounds:
            node.link.spin_for(start_s + node.num_published / 10 - time.monotonic())
            node.process.check()
            node.publish(next(clouds))
            growth.look()
        node.settle()
        yield "flows", f"{len(node.replay.arrived_s):,}", bool(node.replay.arrived_s)
        yield from growth.figures()
        yield from node.balance()


def large_clouds(rounds: Rounds) -> Iterator[Figure]:
    """Full sweeps, until nothing grows, five clouds of two million points, full sweeps again."""
    with live_node(OFTEN) as node:
        clouds, huge = _clouds(), serialized(_huge_sweep())
        for _ in rounds:
            states = []
            for number, cloud in ((200, None), (5, huge), (_NUM_AFTER, None)):
                for _ in range(number):
                    node.process.check()
                    node.publish(cloud or next(clouds))
                    node.link.spin_for(0.1 if cloud is None else 2.0)
                node.settle()
                states.append(node.state()["MB"])
            text = " -> ".join(f"{mb:.0f}" for mb in states) + " MB"
            is_back = states[-1] - states[0] <= _MAX_KEPT_MB
            yield "memory before, with, after them", text, is_back
        yield from node.balance()


def _huge_sweep() -> Sweep:
    """Two million points along a street."""
    xyz = simulated_sweeps(0, 1)[0].sweep.xyz
    xyz = np.resize(xyz, (_HUGE, 3))
    random = np.random.default_rng(0)
    return Sweep(xyz + random.normal(0, 0.05, xyz.shape).astype(np.float32), 0, "lidar")


def overload(rounds: Rounds) -> Iterator[Figure]:
    """20 Hz beside busy cores, more than the machine manages: latency is bounded, nothing grows.

    Latency and estimates are what the node says of each flow, and the flow is heard as the small
    cloud of what moves: on a busy machine this process is slower than the node.
    """
    times_ms: dict[str, list[float]] = {"processing_time": [], "pipeline_latency": []}
    with ExitStack() as stack:
        node = stack.enter_context(live_node(OFTEN, flow_topic="/scene_flow/flow/moving"))
        for name, values in times_ms.items():
            node.link.subscribe(
                f"/scene_flow/debug/{name}_ms",
                "std_msgs/msg/Float64",
                lambda raw, values=values: values.append(deserialize_message(raw, Float64).data),
                depth=100,
            )
        stack.enter_context(busy_cores(os.cpu_count() or 1))
        clouds, start_s, growth = _clouds(), time.monotonic(), _Growth(node)
        due_s = start_s
        for _ in rounds:
            node.link.spin_for(due_s - time.monotonic())
            node.process.check()
            node.publish(next(clouds), INTERVAL_NS // 2)
            growth.look()
            # A lidar does not make up for lost time.
            due_s = max(due_s + 1 / 20, time.monotonic())
        rate_hz = node.num_published / (time.monotonic() - start_s)
        node.settle()
        flows, sweeps = node.link.counts.get("flows_out", 0), node.num_published
        text = f"{flows:,} of {sweeps:,} sweeps at {rate_hz:.1f} Hz"
        yield "flows", text, flows > 0 and sweeps - flows > _MIN_DROPPED * sweeps
        for percentile in (50, 95, 99):
            estimate_ms, latency_ms = (
                float(np.percentile(values or [math.nan], percentile))
                for values in times_ms.values()
            )
            text = f"{latency_ms:.0f} ms, an estimate takes {estimate_ms:.0f} ms"
            yield f"latency, {percentile}th percentile", text, latency_ms <= 2 * estimate_ms
        outside_ms = float(np.median(node.replay.latencies_ms or [math.nan]))
        yield "from publication to arrival, median", f"{outside_ms:.0f} ms", True
        yield from growth.figures()
        yield from node.balance()


def clouds(rounds: Rounds) -> Iterator[Figure]:
    """Hostile clouds of every kind between good sweeps."""
    good = serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)
    with live_node(OFTEN, "node.always_estimate:=true") as node:
        answered, asked = 0, 0
        log_before = node.log.stat().st_size
        for number, random in rounds:
            node.process.check()
            between = with_stamp(good, FIRST_NS + node.num_good * INTERVAL_NS - INTERVAL_NS // 2)
            node.link.publish_bytes(hostile(KINDS[number % len(KINDS)], between, random))
            node.num_published += 1
            node.publish(good)
            node.link.spin_for(_PAUSE_S)
            if number % 100 == 0:
                asked += 1
                answered += is_answered(node, good)
        node.settle()
        counts = node.link.counts
        yield f"of {len(KINDS)} kinds, good sweeps answered", *_of(answered, asked)
        bad = max(1, counts.get("clouds_undecodable", 0) + counts.get("clouds_empty", 0))
        log_bytes = (node.log.stat().st_size - log_before) / rounds.done
        yield "log", f"{log_bytes:.1f} bytes each; {bad:,} undecodable or empty", log_bytes <= 10
        yield from node.balance()


def _of(number: int, whole: int) -> tuple[str, bool]:
    return f"{number:,} of {whole:,}", number == whole


def is_answered(node: LiveNode, good: bytearray) -> bool:
    """Whether flow comes for one of some good sweeps in a row."""
    before = len(node.replay.arrived_s)
    deadline_s = time.monotonic() + _FLOW_TIMEOUT_S
    while len(node.replay.arrived_s) == before and time.monotonic() < deadline_s:
        node.publish(good)
        node.link.spin_for(0.1)
    return len(node.replay.arrived_s) > before


def killed_nodes(rounds: Rounds) -> Iterator[Figure]:
    """SIGKILL of the node, by turns while it starts and after it has answered."""
    prepare_environment()
    good = serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)
    arguments = ["-r", "~/points:=/points"]
    found: Counter[str] = Counter()
    arrived: list[int] = []
    link = ReplayLink("/points", "/scene_flow/flow", lambda f: arrived.append(f.stamp_ns), id)
    with tempfile.TemporaryDirectory() as folder, link:
        log = Path(folder, "log")
        for number, random in rounds:
            with node_process(arguments, log) as process:
                end_s = time.monotonic() + random.uniform(0, _NODE_START_S)
                if number % 2 == 0:
                    arrived.clear()
                    deadline_s = time.monotonic() + _FLOW_TIMEOUT_S
                    while not arrived and time.monotonic() < deadline_s:
                        process.check()
                        link.publish(with_stamp(good, time.time_ns()))
                        link.spin_for(0.1)
                    found["flow after the next start" if arrived else "wrong: no flow"] += 1
                    end_s = time.monotonic() + random.uniform(0, 1)
                while time.monotonic() < end_s:
                    link.publish(with_stamp(good, time.time_ns()))
                    link.spin_for(min(0.1, end_s - time.monotonic()))
                found["killed while it starts"] += number % 2
                os.kill(process.pid, signal.SIGKILL)
        # A node that starts removes what is older than a minute.
        time.sleep(_OLD_S)
        with node_process(arguments, log):
            link.spin_for(_NODE_START_S)
            left_mb = remove_dead_segments() / 1e6
    yield fates("node killed", found)
    yield "left in /dev/shm by the killed", f"{left_mb:.0f} MB", left_mb < _MAX_SHARED_MB


def killed_publishers(rounds: Rounds) -> Iterator[Figure]:
    """Publishers in processes of their own are killed, one after the other; the node goes on."""
    good = serialized(simulated_sweeps(0, 1, num_beams=16, num_columns=360)[0].sweep)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([ReplayLink.__module__, with_stamp.__module__])
    found: Counter[str] = Counter()
    with live_node("node.diagnostics_period_s:=0.2", "node.always_estimate:=true") as node:
        for _, random in rounds:
            publisher = context.Process(target=_publish_for_ever, args=(good,), daemon=True)
            publisher.start()
            before = node.link.counts.get("flows_out", 0)
            deadline_s = time.monotonic() + _FLOW_TIMEOUT_S
            is_answered = False
            while not is_answered and time.monotonic() < deadline_s:
                node.process.check()
                node.link.spin_for(0.1)
                is_answered = node.link.counts.get("flows_out", 0) > before
            found["flow for the next one" if is_answered else "wrong: no flow"] += 1
            time.sleep(random.uniform(0, 0.3))
            publisher.kill()
            publisher.join()
        tracebacks = node.log.read_text(errors="replace").count("Traceback")
    yield fates("publisher killed", found)
    yield "tracebacks in the log", str(tracebacks), tracebacks == 0


def _publish_for_ever(good: bytearray) -> None:
    with ReplayLink("/points", "/elsewhere", id, id) as link:
        while True:
            link.publish(with_stamp(good, time.time_ns()))
            link.spin_for(0.1)


PROMISES: Final = {
    "publishers": Promise(
        "SIGKILL of publishers: the node goes on", *(100, "kills", killed_publishers)
    ),
    "nodes": Promise(
        "SIGKILL of the node at any moment: flow after the next start",
        *(200, "kills", killed_nodes),
    ),
    "clouds": Promise(
        "hostile clouds of every kind between good sweeps: alive, good sweeps answered, "
        "everything accounted for, log at most 10 bytes each",
        *(10_000, "clouds", clouds),
    ),
    "large": Promise(
        "five clouds of two million points: their memory goes back but for 100 MB",
        *(1, "times", large_clouds),
    ),
    "overload": Promise(
        "1 h at 20 Hz beside a busy loop on each core, more than the machine manages: latency at "
        "most that of two estimates, every triplet out or counted, nothing grows",
        *(72_000, "sweeps", overload),
    ),
    "soak": Promise(
        "24 h at 10 Hz, full sweeps: growth at most 20 MB after the first 10 min, no descriptor, "
        "thread or segment more, everything accounted for",
        *(864_000, "sweeps", soak),
    ),
}
