# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the online method costs: CPU beside KISS-ICP on the same sweeps, memory, and the start."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray
from online_live import serialized, with_stamp
from online_recordings import INTERVAL_NS, real_sweeps, simulated_sweeps, to_and_fro

from mnsf_ros.demo.node_process import NodeProcess, node_process
from mnsf_ros.methods import make_method
from mnsf_ros.node.environment import prepare_environment
from mnsf_ros.node.process_memory import RETURN_PERIOD_S, keep_memory
from mnsf_ros.node.replay_link import ReplayLink
from mnsf_ros.online.online_pipeline import SWEEPS_RECEIVED, TRIPLET_ENDS, TRIPLETS_FORMED
from mnsf_ros.presets import preset
from mnsf_ros.report.text_table import TextTable
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

# The first estimates are left out: nothing is known yet, and the caches are cold.
_WARM_UP: Final = 4
# The same ones in every turn: five sweeps from here on, to and fro.
_FIRST_OF_TURN: Final = 8
_SWEEPS_PER_TURN: Final = 8
# The first round is one to warm up, too.
_NUM_ROUNDS: Final = 4
# How often the node says what it has done; it gets the next sweep then.
_STATUS_S: Final = 0.5
_SWEEP_TIMEOUT_S: Final = 10
_MAX_ESTIMATE: Final = 0.5
# There points lie on few planes: registration alone costs little.
_MAX_ON_STREET: Final = 0.8
_MAX_PROCESS: Final = 0.75
_MAX_SHARE: Final = 0.5
_MAX_MEMORY_MB: Final = 250
_MAX_LEFT_MB: Final = 20
_MAX_START_S: Final = 1.0
_NUM_LARGE: Final = 2_000_000
_START_TIMEOUT_S: Final = 120
_TOPICS: Final = {
    "~/flow": "/scene_flow/flow",
    "~/flow/moving": "/scene_flow/flow/moving",
    "~/objects": "/scene_flow/objects",
}


# A KISS-ICP, or None where the package is not installed.
Kiss: TypeAlias = Any
Floats: TypeAlias = NDArray[np.float64]


def cost_tables(*, quick: bool) -> Iterator[TextTable]:
    """One table: a row for each target."""
    prepare_environment()
    keep_memory()  # as the node does
    street = [item.sweep for item in simulated_sweeps(0, 24)]
    full = [replace(item.sweep, times_s=None) for item in real_sweeps("kitti_0005")[:24]] or street
    rows = [
        _estimate_row("CPU of one estimate", full, _MAX_ESTIMATE),
        _estimate_row("CPU of one estimate, simulated street", street, _MAX_ON_STREET),
        *_process_rows(full, num_rounds=2 if quick else _NUM_ROUNDS),
        *([] if quick else _memory_rows(full)),
    ]
    yield TextTable(["target", "limit", "measured", ""], rows, f"Cost, {len(full[0]):,} points")


def _ratio_row(name: str, ratio: float, own_ms: float, limit: float) -> list[str]:
    if np.isnan(ratio):
        name = f"{name} over KISS-ICP's (not installed: pip install '.[benchmark]')"
        return [name, f"{limit}", f"{own_ms:.0f} ms", "-"]
    text = f"{ratio:.2f} ({own_ms:.0f} ms)"
    return [f"{name} over KISS-ICP's, one thread", f"{limit}", text, _verdict(ratio <= limit)]


def _estimate_row(name: str, sweeps: Sequence[Sweep], limit: float) -> list[str]:
    """CPU of one estimate over that of one registration, alternately."""
    kiss = _kiss_icp()
    estimator = make_method("online", preset("online").changed({"compute.num_threads": 1}))
    ours, theirs = [], []
    for triplet in zip(sweeps, sweeps[1:], sweeps[2:], strict=False):
        start_s = time.process_time()
        estimator.estimate(SweepTriplet(*triplet))
        ours.append(1e3 * (time.process_time() - start_s))
        theirs.append(_kiss_ms(kiss, triplet[2]))
    own_ms = float(np.median(ours[_WARM_UP:]))
    return _ratio_row(name, own_ms / float(np.median(theirs[_WARM_UP:])), own_ms, limit)


def _kiss_ms(kiss: Kiss, sweep: Sweep) -> float:
    """CPU of the registration of a sweep."""
    if kiss is None:
        return float("nan")
    xyz = sweep.xyz.astype(np.float64)
    start_s = time.process_time()
    kiss.register_frame(xyz, np.zeros(0))
    return 1e3 * (time.process_time() - start_s)


def _process_rows(sweeps: Sequence[Sweep], num_rounds: int) -> Iterator[list[str]]:
    """CPU of the node's whole process a sweep, by what is subscribed to, in turns."""
    costs_ms: dict[str, list[float]] = {name: [] for name in (*_TOPICS, "nothing")}
    ratios = []
    played = to_and_fro(sweeps[_FIRST_OF_TURN:][: _SWEEPS_PER_TURN // 2 + 1])
    with _running_node("-p", "node.always_estimate:=true") as (node, link, start_s):
        clouds, index = list(map(serialized, played)), 0
        for round_number in range(-1, num_rounds):
            for name, values in costs_ms.items():
                with _subscriber(_TOPICS.get(name)):
                    before_s = node.cpu_s
                    _play(link, clouds, index, _SWEEPS_PER_TURN)
                    used_ms = 1e3 * (node.cpu_s - before_s) / _SWEEPS_PER_TURN
                index += _SWEEPS_PER_TURN
                if round_number >= 0:
                    values.append(used_ms)
            # On the whole drive: to and fro in a map of five sweeps it would have less to do.
            kiss = _kiss_icp()
            theirs_ms = [_kiss_ms(kiss, sweep) for sweep in sweeps][_WARM_UP:]
            if round_number >= 0:
                ratios.append(costs_ms["~/flow"][-1] / float(np.median(theirs_ms)))
    yield [
        "start until ready",
        f"{_MAX_START_S} s",
        f"{start_s:.1f} s",
        _verdict(start_s <= _MAX_START_S),
    ]
    own_ms = {name: float(np.median(values)) for name, values in costs_ms.items()}
    ratio = float(np.median(ratios))
    yield _ratio_row("CPU of the node a sweep, ~/flow", ratio, own_ms["~/flow"], _MAX_PROCESS)
    nothing_ms = np.array(costs_ms["nothing"])
    for name in list(_TOPICS)[1:]:
        more_ms = (np.array(costs_ms[each]) - nothing_ms for each in (name, "~/flow"))
        yield share_row(f"CPU of building and sending {name}, over that of ~/flow", *more_ms)


def share_row(name: str, part_ms: Floats, whole_ms: Floats) -> list[str]:
    """The share of a part in a whole, each of them a difference of two turns in every round.

    The differences scatter from round to round. A verdict that they may turn over is none.
    """
    part, whole = float(np.median(part_ms)), float(np.median(whole_ms))
    scatter = max(float(np.ptp(values)) / 2 for values in (part_ms, whole_ms))
    text = f"{part:.0f} of {whole:.0f} ms, each +- {scatter:.0f}"
    verdict = "noise"
    if whole > scatter and part > -scatter:
        text = f"{part / whole:.2f} ({text})"
        if part + scatter <= _MAX_SHARE * (whole - scatter):
            verdict = "met"
        elif part - scatter > _MAX_SHARE * (whole + scatter):
            verdict = "MISSED"
    return [name, f"{_MAX_SHARE}", text, verdict]


@contextlib.contextmanager
def _subscriber(topic: str | None) -> Iterator[None]:
    """Somebody who subscribes to a topic and, once it is found, only lets clouds come."""
    if topic is None:
        yield
        return
    import rclpy
    from rclpy.context import Context
    from sensor_msgs.msg import PointCloud2

    context = Context()
    rclpy.init(args=[], context=context)
    listener = rclpy.create_node("cost_listener", context=context)
    subscription = listener.create_subscription(PointCloud2, topic, lambda raw: None, 1, raw=True)
    deadline_s = time.monotonic() + _START_TIMEOUT_S
    while subscription.get_publisher_count() == 0 and time.monotonic() < deadline_s:
        time.sleep(0.05)
    time.sleep(1.0)
    yield
    listener.destroy_node()
    context.try_shutdown()


def _kiss_icp() -> Kiss:
    if importlib.util.find_spec("kiss_icp") is None:
        return None
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.max_range, config.data.min_range, config.data.deskew = 100.0, 1.0, False
    config.registration.max_num_threads, config.mapping.voxel_size = 1, 1.0
    return KissICP(config)


def _memory_rows(sweeps: Sequence[Sweep]) -> Iterator[list[str]]:
    """Memory of the node before, with and after clouds that are far larger."""
    with _running_node() as (node, link, _), _subscriber(_TOPICS["~/flow"]):
        clouds = to_and_fro(map(serialized, sweeps))
        _play(link, clouds, 0, 20)
        before_mb = node.resident_mb
        yield [
            "memory of the node, full sweeps",
            f"{_MAX_MEMORY_MB} MB",
            f"{before_mb:.0f} MB",
            _verdict(before_mb <= _MAX_MEMORY_MB),
        ]
        _play(link, [_large_cloud(sweeps[0])], 20, 5)
        large_mb = node.resident_mb
        index, end_s = 25, time.monotonic() + 2 * RETURN_PERIOD_S
        while time.monotonic() < end_s:
            _play(link, clouds, index, _SWEEPS_PER_TURN)
            index += _SWEEPS_PER_TURN
        after_mb, limit_mb = node.resident_mb, before_mb + _MAX_LEFT_MB
        yield [
            f"memory of the node after sweeps of {_NUM_LARGE:,} points ({large_mb:.0f} MB)",
            f"{limit_mb:.0f} MB",
            f"{after_mb:.0f} MB",
            _verdict(after_mb <= limit_mb),
        ]


def _large_cloud(sweep: Sweep) -> bytearray:
    """Two million points around those of a sweep."""
    times = -(-_NUM_LARGE // len(sweep))
    noise = np.random.default_rng(0).normal(scale=0.02, size=(times * len(sweep), 3))
    xyz = (np.tile(sweep.xyz, (times, 1)) + noise)[:_NUM_LARGE].astype(np.float32)
    return serialized(Sweep(xyz))


@contextlib.contextmanager
def _running_node(*arguments: str) -> Iterator[tuple[NodeProcess, ReplayLink, float]]:
    """A node that nobody subscribes to, and how many seconds it took to subscribe to the clouds."""
    with (
        tempfile.TemporaryDirectory() as folder,
        ReplayLink("/points", "/nothing", lambda flow: None, lambda raw: None) as link,
    ):
        log, start_s = Path(folder) / "node.log", time.monotonic()
        status = f"node.diagnostics_period_s:={_STATUS_S}"
        with node_process(["-r", "~/points:=/points", "-p", status, *arguments], log) as node:
            while not link.is_heard and time.monotonic() < start_s + _START_TIMEOUT_S:
                node.check()
                link.spin_for(0.02)
            yield node, link, time.monotonic() - start_s


def _play(link: ReplayLink, clouds: Sequence[bytearray], first: int, number: int) -> None:
    """Publishes clouds as sweeps of 10 Hz, each when the node is done with the one before.

    On a busy machine it would drop some otherwise, and those cost less.
    """
    received = link.counts.get(SWEEPS_RECEIVED, 0)
    for index in range(first, first + number):
        link.publish(with_stamp(clouds[index % len(clouds)], 10**18 + index * INTERVAL_NS))
        received += 1
        deadline_s = time.monotonic() + _SWEEP_TIMEOUT_S
        while not _is_done(link, received) and time.monotonic() < deadline_s:
            link.spin_for(_STATUS_S / 5)


def _is_done(link: ReplayLink, received: int) -> bool:
    """Whether so many sweeps have come, and nothing is under way."""
    counts = link.counts
    ended = sum(counts.get(event, 0) for event in TRIPLET_ENDS)
    is_idle = ended == counts.get(TRIPLETS_FORMED, 0)
    return is_idle and counts.get(SWEEPS_RECEIVED, 0) >= received


def _verdict(holds: bool) -> str:
    return "met" if holds else "MISSED"


if __name__ == "__main__":
    os.environ["OMP_NUM_THREADS"] = "1"
    from rich.console import Console

    for each in cost_tables(quick=False):
        Console(width=140).print(each)
