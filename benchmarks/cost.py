# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Cost of `online`, `neural` and the node: CPU beside KISS-ICP in one run, memory, start.

    python benchmarks/cost.py [--quick] [--document FILE]

KISS-ICP registers the same sweeps on one thread, in turns (`pip install '.[benchmark]'`). Sweeps
are those of KITTI 0005 if the shared data is there (see drives.py), and of a simulated street. Use
a ROS_DOMAIN_ID of its own.
"""

from __future__ import annotations

import importlib.util
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final

# Before libraries with threads of their own are loaded.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from drives import TrueSweep, real_sweeps, simulated_sweeps, to_and_fro, triplet_at
from frame import TARGET_HEADER, Table, Target, make_parser, publish
from live_node import FLOW_TOPIC, LiveNode, live_node, serialized

from mnsf_ros.methods import make_method
from mnsf_ros.node.environment import RETURN_PERIOD_S, keep_memory, prepare_environment
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import Sweep

# The first estimates have cold caches and know nothing of the past.
_WARM_UP: Final = 4
# Every turn plays the same five sweeps from here on, to and fro.
_FIRST_OF_TURN: Final = 8
_SWEEPS_PER_TURN: Final = 8
_NUM_ROUNDS: Final = 4
# The node gets its next sweep when its diagnostics say that it is done.
_STATUS_S: Final = 0.5
_SWEEP_TIMEOUT_S: Final = 10
_SUBSCRIBE_TIMEOUT_S: Final = 60
_NUM_LARGE: Final = 2_000_000
_MAX_ESTIMATE: Final = 0.5
_MAX_NEURAL: Final = 3.0
# On the few planes of a street a registration is cheap.
_MAX_ON_STREET: Final = 0.8
_MAX_NODE: Final = 0.75
_MAX_MEMORY_MB: Final = 250
_MAX_LEFT_MB: Final = 20
_MAX_START_S: Final = 1.0


def main() -> None:
    """Measures, prints the tables, and writes them into a document."""
    parser = make_parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="one round")
    options = parser.parse_args()
    publish("cost", tables(quick=options.quick), options.document)


def tables(*, quick: bool) -> Iterator[Table]:
    """One row for each target."""
    prepare_environment()
    keep_memory()  # as the node does
    street = simulated_sweeps(0, 24)
    kitti = [
        replace(item, sweep=replace(item.sweep, times_s=None))
        for item in real_sweeps("kitti_0005")[:24]
    ]
    full = kitti or street
    targets = [
        _estimate_target("CPU of an estimate", full, _MAX_ESTIMATE),
        _estimate_target("CPU of an estimate, street", street, _MAX_ON_STREET),
        _estimate_target("CPU of an estimate of `neural`", full, _MAX_NEURAL, "neural"),
        *_node_targets([item.sweep for item in full], 1 if quick else _NUM_ROUNDS),
    ]
    title = f"{len(full[0].sweep):,} points"
    yield Table(title, TARGET_HEADER, [target.row() for target in targets])


def _kiss_icp() -> Any:  # noqa: ANN401 - of a library without types
    """A KISS-ICP, or None if it is not installed."""
    if importlib.util.find_spec("kiss_icp") is None:
        return None
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.max_range, config.data.min_range, config.data.deskew = 100.0, 1.0, False
    config.registration.max_num_threads = 1
    config.mapping.voxel_size = 1.0
    return KissICP(config)


def _kiss_ms(kiss: Any, sweep: Sweep) -> float:  # noqa: ANN401
    """CPU time of the registration of a sweep; NaN without KISS-ICP."""
    if kiss is None:
        return float("nan")
    xyz = sweep.xyz.astype(np.float64)
    start_s = time.process_time()
    kiss.register_frame(xyz, np.zeros(0))
    return 1e3 * (time.process_time() - start_s)


def _ratio_target(name: str, own_ms: float, ratio: float, limit: float) -> Target:
    text = f"{own_ms:.0f} ms" if np.isnan(ratio) else f"{ratio:.2f} ({own_ms:.0f} ms)"
    return Target(f"{name} over KISS-ICP's, one thread", limit, ratio, text=text)


def _estimate_target(
    name: str, sweeps: Sequence[TrueSweep], limit: float, method: str = "online"
) -> Target:
    """CPU of one estimate over that of one registration, in turns."""
    kiss = _kiss_icp()
    estimator = make_method(method, preset(method).changed({"compute.num_threads": 1}))
    ours, theirs = [], []
    for index in range(1, len(sweeps) - 1):
        triplet = triplet_at(sweeps, index)
        start_s = time.process_time()
        estimator.estimate(triplet)
        ours.append(1e3 * (time.process_time() - start_s))
        theirs.append(_kiss_ms(kiss, triplet.next))
    own_ms, kiss_ms = (float(np.median(times[_WARM_UP:])) for times in (ours, theirs))
    return _ratio_target(name, own_ms, own_ms / kiss_ms, limit)


def _node_targets(sweeps: Sequence[Sweep], num_rounds: int) -> Iterator[Target]:
    """CPU of the node's process with a subscriber of its flow, its start and its memory."""
    costs_ms, ratios = [], []
    status = f"node.diagnostics_period_s:={_STATUS_S}"
    with live_node(status, flow_topic=None) as node, _subscriber(FLOW_TOPIC):
        turn = to_and_fro(sweeps[_FIRST_OF_TURN:][: _SWEEPS_PER_TURN // 2 + 1])
        clouds = [serialized(sweep) for sweep in turn]
        _play(node, clouds)
        for _ in range(num_rounds):
            before_s = node.cpu_s
            _play(node, clouds)
            costs_ms.append(1e3 * (node.cpu_s - before_s) / len(clouds))
            kiss = _kiss_icp()
            theirs_ms = [_kiss_ms(kiss, sweep) for sweep in sweeps][_WARM_UP:]
            ratios.append(costs_ms[-1] / float(np.median(theirs_ms)))
        before_mb, large_mb, after_mb = _memories_mb(node, clouds, _large_cloud(sweeps[0]))
    own_ms, ratio = float(np.median(costs_ms)), float(np.median(ratios))
    yield _ratio_target("CPU of the node a sweep, ~/flow", own_ms, ratio, _MAX_NODE)
    yield Target("start until ready (s)", _MAX_START_S, node.start_s)
    yield Target("memory of the node (MB)", _MAX_MEMORY_MB, before_mb)
    name = f"memory left after {large_mb:.0f} MB with {_NUM_LARGE:,} points (MB more)"
    yield Target(name, _MAX_LEFT_MB, after_mb - before_mb)


def _memories_mb(
    node: LiveNode, clouds: Sequence[bytearray], large: bytearray
) -> tuple[float, float, float]:
    """Memory of the node before large clouds, with them, and after it could return it."""
    _play(node, clouds)
    before_mb = node.memory_mb()
    _play(node, [large] * 5)
    large_mb, end_s = node.memory_mb(), time.monotonic() + 2 * RETURN_PERIOD_S
    while time.monotonic() < end_s:
        _play(node, clouds)
    return before_mb, large_mb, node.memory_mb()


@contextmanager
def _subscriber(topic: str) -> Iterator[None]:
    """A subscriber of clouds that only receives them; its CPU is that of this process."""
    import rclpy
    from rclpy.context import Context
    from sensor_msgs.msg import PointCloud2

    context = Context()
    rclpy.init(args=[], context=context)
    listener = rclpy.create_node("cost_listener", context=context)
    subscription = listener.create_subscription(PointCloud2, topic, lambda raw: None, 1, raw=True)
    deadline_s = time.monotonic() + _SUBSCRIBE_TIMEOUT_S
    while subscription.get_publisher_count() == 0 and time.monotonic() < deadline_s:
        time.sleep(0.05)
    time.sleep(1.0)
    yield
    listener.destroy_node()
    context.try_shutdown()


def _play(node: LiveNode, clouds: Sequence[bytearray]) -> None:
    """Publishes clouds, each when the node is done with the one before: it drops none."""
    for cloud in clouds:
        node.publish(cloud)
        deadline_s = time.monotonic() + _SWEEP_TIMEOUT_S
        while not _is_done(node) and time.monotonic() < deadline_s:
            node.spin_for(_STATUS_S / 5)


def _is_done(node: LiveNode) -> bool:
    counts = node.counts
    is_idle = node.num_ended == counts.get("triplets_formed", 0)
    return is_idle and counts.get("sweeps_received", 0) >= node.num_published


def _large_cloud(sweep: Sweep) -> bytearray:
    """Two million points around those of a sweep."""
    xyz = np.resize(sweep.xyz, (_NUM_LARGE, 3))
    noise = np.random.default_rng(0).normal(scale=0.02, size=xyz.shape).astype(np.float32)
    return serialized(Sweep(xyz + noise))


if __name__ == "__main__":
    main()
