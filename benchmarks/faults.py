# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Faults of the input: whether each is told, by what words, and after how many seconds.

    python benchmarks/faults.py [--only WORD] [--no-node] [--seed N]

Each fault begins after some good sweeps of a simulated street. What sweeps show is tried by the
public stream and the input check, as the node has them; the others by a node in a process of its
own: use a ROS_DOMAIN_ID of its own for it.
"""

import struct
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Final

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from drives import random_world
from frame import TARGET_HEADER, Table, Target, make_parser, publish
from live_node import live_node, serialized, with_stamp

from mnsf_ros.errors import MnsfError
from mnsf_ros.input_check.input_check import InputCheck
from mnsf_ros.input_check.sweep_sample import Located
from mnsf_ros.presets import preset
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import Sweep

NUM_GOOD: Final = 40
NUM_BAD: Final = 40
INTERVAL_S: Final = 0.1
_HEADER: Final = ("fault", "what is said", "after (s)", "told")
# As the node: the first sweeps of a driver are odd.
_MIN_CHECKED: Final = 20
_MAX_TEXT: Final = 90
_KIND: Final = 40
# Of a serialized message, before its stamp.
_ENCODING_BYTES: Final = 4
# Statuses of a node come as often as its clouds.
_PERIOD: Final = "node.diagnostics_period_s:=0.1"
# Of a computer that others use, too, and of the last node, which DDS has not forgotten yet.
_OTHER: Final = ("CPU busy", "latency above", "clouds are missed", "2 nodes")

# Sweeps from a number on, to what comes instead of the one of this number.
Spoil = Callable[[Sequence[Sweep], int], Sweep]


@dataclass(frozen=True)
class Fault:
    """A fault that sweeps show; `begin` is the number of the first bad one."""

    spoil: Spoil
    begin: int = NUM_GOOD
    is_turning: bool = False  # tried on a robot that turns


@dataclass(frozen=True)
class Told:
    """What was said of a fault, and after how many seconds; no text if nothing was."""

    text: str = ""
    after_s: float = 0.0

    def row(self, name: str) -> list[str]:
        """Cells for the table."""
        text = self.text if len(self.text) <= _MAX_TEXT else f"{self.text[:_MAX_TEXT]} ..."
        after = f"{self.after_s:.1f}" if self.text else ""
        return [name, text or "-", after, "yes" if self.text else "NO"]


def main() -> None:
    """Tries all faults, and prints the tables."""
    parser = make_parser(__doc__, has_document=False)
    parser.add_argument("--only", default="", metavar="WORD", help="faults with this word")
    parser.add_argument("--no-node", action="store_true", help="only what sweeps show")
    parser.add_argument("--seed", type=int, default=0, help="of the street")
    options = parser.parse_args()
    publish("faults", _tables(options.only, options.seed, has_node=not options.no_node), None)


def _tables(word: str, seed: int, *, has_node: bool) -> Iterator[Table]:
    faults = {name: fault for name, fault in FAULTS.items() if word in name}
    found = {name: told_by_stream(fault, seed) for name, fault in faults.items()}
    yield fault_table("Faults that sweeps show", found)
    if has_node and (spoilers := {name: each for name, each in LIVE.items() if word in name}):
        live = {name: _told_by_node(spoil, seed) for name, spoil in spoilers.items()}
        yield fault_table("Faults at the node", live)
        found |= live
    number = sum(bool(told.text) for told in found.values())
    target = Target("faults told", len(found), number, is_minimum=True)
    yield Table("Targets", TARGET_HEADER, [target.row()])


def fault_table(title: str, found: Mapping[str, Told]) -> Table:
    """The table of what was said of each fault."""
    return Table(title, _HEADER, [told.row(name) for name, told in found.items()])


# Faults that sweeps show


def told_by_stream(fault: Fault, seed: int) -> Told:
    """Tries a fault by the stream and the input check."""
    sweeps = list(_turning(seed) if fault.is_turning else _street(seed))
    settings = preset("online")
    stream = Stream(settings)
    check = InputCheck(settings, stream.mounting, stream.rotation, is_live=True)
    before: set[str] = set()
    for number, good in enumerate(sweeps):
        sweep = good if number < fault.begin else fault.spoil(sweeps, number)
        if len(sweep) == 0:
            continue
        said = _said(stream, check, sweep)
        if check.num_clouds <= _MIN_CHECKED or number < fault.begin:
            before |= {kind for kind, _ in said} if number < fault.begin else set()
            continue
        for kind, text in said:
            if kind not in before:
                return Told(text, (number - fault.begin + 1) * INTERVAL_S)
    return Told()


def _said(stream: Stream, check: InputCheck, sweep: Sweep) -> list[tuple[str, str]]:
    """What is said at a sweep: its kind, and its text."""
    said = []
    check.add(sweep)
    try:
        estimate = stream.push(sweep)
    except MnsfError as error:
        said.append(("flow", f"flow: {error}"))
    else:
        if estimate is not None and stream.triplet is not None:
            check.locate(Located.by(estimate, stream.triplet.current))
            if estimate.over_ground is not None and estimate.over_ground.lost:
                said.append(("lost", f"ego motion: {estimate.over_ground.lost}"))
    return said + [(one.assumption, str(one)) for one in check.findings() if one.is_wrong]


@cache
def _street(seed: int) -> tuple[Sweep, ...]:
    """Sweeps of a turning lidar in a street, with times."""
    settings = SimulationSettings(
        seed=seed, num_beams=32, num_columns=900, duration_s=INTERVAL_S * (NUM_GOOD + NUM_BAD)
    )
    simulator = SweepSimulator(settings)
    sensor = replace(simulator.scene.sensor, is_rolling=True)
    simulator.scene = replace(simulator.scene, sensor=sensor)
    return tuple(
        Sweep(
            one.xyz,
            one.truth.stamp_ns,
            "lidar",
            times_s=(one.columns["t"] / 1e9).astype(np.float32),
        )
        for one in simulator
    )


@cache
def _turning(seed: int) -> tuple[Sweep, ...]:
    """Sweeps of a robot with hard turns, an IMU and odometry."""
    world = random_world(seed, NUM_GOOD + NUM_BAD, "turns")
    return tuple(replace(one.sweep, odometry=one.pose) for one in world.sweeps)


def _azimuths_deg(sweep: Sweep) -> Any:  # noqa: ANN401 - (N,)
    return np.degrees(np.arctan2(sweep.xyz[:, 1], sweep.xyz[:, 0]))


def _changed(sweep: Sweep, xyz: Any) -> Sweep:  # noqa: ANN401 - (N, 3)
    return replace(sweep, xyz=np.ascontiguousarray(xyz, np.float32))


def _of_each(change: Callable[[Sweep], Sweep]) -> Spoil:
    return lambda sweeps, number: change(sweeps[number])


def _frozen(among: int) -> Spoil:
    """The last good clouds in turn, under new stamps."""

    def again(sweeps: Sequence[Sweep], number: int) -> Sweep:
        now, last = sweeps[number], sweeps[NUM_GOOD - 1 - number % among]
        return replace(last, stamp_ns=now.stamp_ns)

    return again


def _near(sweep: Sweep, rows: Any, ranges_m: Any) -> Sweep:  # noqa: ANN401 - (N,), (N,) or one
    own_m = np.linalg.norm(sweep.xyz, axis=1)
    factors = np.where(rows, np.minimum(1.0, ranges_m / np.maximum(own_m, 1e-3)), 1.0)
    return _changed(sweep, sweep.xyz * factors[:, None])


def _fog(sweep: Sweep, to_m: float) -> Sweep:
    rng = np.random.default_rng(sweep.stamp_ns)
    return _near(sweep, rng.random(len(sweep)) < 0.7, rng.uniform(0.8, to_m, len(sweep)))


def _thinned(sweep: Sweep, share: float) -> Sweep:
    return sweep.part(np.random.default_rng(sweep.stamp_ns).random(len(sweep)) < share)


def _odometry_of(back: int) -> Spoil:
    return lambda sweeps, number: replace(
        sweeps[number], odometry=sweeps[max(0, number - back)].odometry
    )


def _turned(sweep: Sweep) -> Sweep:
    return _changed(sweep, sweep.xyz[:, [1, 0, 2]] * [-1, 1, 1])


def _jittered(sweep: Sweep) -> Sweep:
    off_ns = int(np.random.default_rng(sweep.stamp_ns).integers(-30_000_000, 30_000_000))
    return replace(sweep, stamp_ns=sweep.stamp_ns + off_ns)


def _without_rates(sweep: Sweep) -> Sweep:
    return replace(sweep, turn_rates=np.zeros((0, 4)))


FAULTS: Final = {
    "the last cloud again and again": Fault(_frozen(1)),
    "the last two clouds in turn": Fault(_frozen(2)),
    "the last three clouds in turn": Fault(_frozen(3)),
    "front half blind": Fault(_of_each(lambda one: one.part(np.abs(_azimuths_deg(one)) > 90))),
    "75 degrees blind": Fault(_of_each(lambda one: one.part(np.abs(_azimuths_deg(one)) > 37.5))),
    "2 % of the points left": Fault(_of_each(lambda one: _thinned(one, 0.02))),
    "70 % scattered within 4 m": Fault(_of_each(lambda one: _fog(one, 4.0))),
    "70 % scattered within 6 m": Fault(_of_each(lambda one: _fog(one, 6.0))),
    "a hand on the dome": Fault(
        _of_each(lambda one: _near(one, np.abs(_azimuths_deg(one)) < 126, 0.15))
    ),
    "ranges halved": Fault(_of_each(lambda one: _changed(one, one.xyz / 2))),
    "y mirrored": Fault(_of_each(lambda one: _changed(one, one.xyz * [1, -1, 1]))),
    "x and y swapped": Fault(_of_each(lambda one: _changed(one, one.xyz[:, [1, 0, 2]]))),
    "jump in yaw of 90 degrees": Fault(_of_each(_turned)),
    "lidar on its side": Fault(
        _of_each(lambda one: _changed(one, one.xyz[:, [0, 2, 1]] * [1, -1, 1])), 0
    ),
    "times an eighth": Fault(
        _of_each(lambda one: replace(one, times_s=np.float32(0.125) * one.times_s)), 0
    ),
    "stamps off by 30 ms": Fault(_of_each(_jittered)),
    "frames in turn": Fault(
        lambda sweeps, number: replace(sweeps[number], frame_id=("lidar", "rear")[number % 2])
    ),
    "odometry of two sweeps before": Fault(_odometry_of(2), 0, is_turning=True),
    "IMU stops": Fault(_of_each(_without_rates), is_turning=True),
}


# Faults at the node


# Number of the cloud, and its serialized message, to what is published instead; None: nothing.
SpoilRaw = Callable[[int, bytes], bytes | None]


def stamp_of(raw: bytes) -> int:
    """Stamp of a serialized cloud, nanoseconds."""
    seconds, nanoseconds = struct.unpack_from("<iI", raw, _ENCODING_BYTES)
    return int(seconds) * 10**9 + int(nanoseconds)


def _later(raw: bytes, off_s: float) -> bytes:
    stamp_ns = stamp_of(raw) + round(off_s * 1e9)
    return with_stamp(bytearray(raw), stamp_ns)


def _with_points(value: float) -> SpoilRaw:
    few = serialized(Sweep(np.full((1000, 3), value, np.float32)))
    return lambda _, raw: with_stamp(few, stamp_of(raw))


def _higher(_number: int, raw: bytes) -> bytes:
    """A cloud of two rows with the data of one: the height follows the frame."""
    data, at = bytearray(raw), raw.index(b"lidar\0") + len("lidar\0")
    at += -(at - _ENCODING_BYTES) % 4
    data[at : at + 4] = (2).to_bytes(4, "little")
    return bytes(data)


LIVE: Final[dict[str, SpoilRaw]] = {
    "stamps 5 s old": lambda _, raw: _later(raw, -5.0),
    "stamps an hour ahead": lambda _, raw: _later(raw, 3600.0),
    "stamps go back": lambda number, raw: _later(raw, -2 * INTERVAL_S * number),
    "stamps stay": lambda number, raw: _later(raw, -INTERVAL_S * number),
    "points are NaN": _with_points(np.nan),
    "points at the origin": _with_points(0.0),
    "data of another size": _higher,
    "no cloud any more": lambda _number, _raw: None,
}


def _told_by_node(spoil: SpoilRaw, seed: int) -> Told:
    """Tries a fault at a node of its own, on clouds of one moment."""
    said: list[tuple[float, str]] = []

    def listen(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.level != DiagnosticStatus.OK and not status.message.startswith(_OTHER):
                part = status.name.rpartition(": ")[2]
                said.append((time.monotonic(), f"{part}: {status.message}"))

    clouds = [serialized(replace(sweep, times_s=None)) for sweep in _street(seed)]
    with live_node(_PERIOD, "node.always_estimate:=true") as node:
        node.subscribe("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", listen)
        start_ns, start_s, begin_s, before = time.time_ns(), time.monotonic(), 0.0, set[str]()
        for number, raw in enumerate(clouds):
            node.spin_for(max(0.0, start_s + INTERVAL_S * number - time.monotonic()))
            if number == NUM_GOOD:
                begin_s, before = time.monotonic(), {_kind(text) for _, text in said}
            good = with_stamp(raw, start_ns + round(1e9 * INTERVAL_S * number))
            bad = good if number < NUM_GOOD else spoil(number - NUM_GOOD + 1, good)
            if bad is not None:
                node.points.publish(bad)
            for told_s, text in said:
                if told_s > begin_s > 0 and _kind(text) not in before:
                    return Told(text, told_s - begin_s)
    return Told()


def _kind(text: str) -> str:
    """A text without its figures."""
    return "".join(letter for letter in text if not letter.isdigit())[:_KIND]


if __name__ == "__main__":
    main()
