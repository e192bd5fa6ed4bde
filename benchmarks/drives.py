# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps with their truth: recorded drives of the shared data, simulated streets, random worlds."""

import hashlib
import json
import os
import pickle
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mnsf_ros import simulation
from mnsf_ros.datasets.kitti import KITTI
from mnsf_ros.geometry.stamped_rate import StampedRate
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import FIRST_STAMP_NS, SweepSimulator
from mnsf_ros.sweeps.rate_track import RateTrack
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

DATA = Path(os.environ.get("MNSF_DATA", Path(__file__).parents[2] / "shared" / "data"))
INTERVAL_NS = 100_000_000
IMU_HZ = 200.0
# Identity of the program that simulates and keeps.
_SOURCES = (*sorted(Path(simulation.__file__).parent.glob("*.py")), Path(__file__))
_SIMULATOR = hashlib.sha256(b"".join(each.read_bytes() for each in _SOURCES)).hexdigest()[:12]

Item = TypeVar("Item")


@dataclass(frozen=True, eq=False)
class TrueSweep:
    """A sweep with its pose, (4, 4) world_from_sensor, and its truth, valid where labelled."""

    sweep: Sweep
    pose: NDArray[np.floating[Any]]
    truth: FlowTruth

    @property
    def scored(self) -> NDArray[np.bool_]:
        """(N,) the points that are labelled, and not on the ground."""
        return self.truth.valid & ~self.truth.ground


def real_sweeps(name: str) -> list[TrueSweep]:
    """Returns the labelled sweeps of a folder of the shared data; none if it is absent."""
    return [_real(path) for path in sorted((DATA / name).glob("sweep_*.npz"))]


def _real(path: Path) -> TrueSweep:
    with np.load(path) as content:
        arrays: dict[str, NDArray[Any]] = dict(content)
    sweep = Sweep(
        np.ascontiguousarray(arrays["xyz"], np.float32),
        int(arrays["stamp_ns"]),
        "lidar",
        times_s=arrays["time_offset"],
    )
    truth = FlowTruth(
        sweep.stamp_ns,
        arrays["flow"],
        # Movers are labelled only in view of the camera; elsewhere they would count as static.
        arrays["flow_valid"] & arrays["label_valid"],
        arrays["is_dynamic"],
        arrays["is_ground"],
        _classes(path, arrays["box_track_id"]),
        (arrays["box_track_id"] + 1).astype(np.uint32),
    )
    return TrueSweep(sweep, arrays["pose"], truth)


def _classes(path: Path, tracks: NDArray[np.integer[Any]]) -> NDArray[np.uint8]:
    """`SurfaceClass` of the points of a sweep, from the boxes in the same folder."""
    boxes = json.loads((path.parent / "boxes.json").read_text())
    known = {box["track_id"]: box["cls"] for sweep in boxes.values() for box in sweep}
    class_id = np.zeros(len(tracks), np.uint8)
    for track_id, name in known.items():
        class_id[tracks == track_id] = KITTI.get(name, 0)
    return class_id


def simulated_sweeps(seed: int, number: int, **settings: float) -> list[TrueSweep]:
    """Returns sweeps of a simulated street; `settings` are those of `SimulationSettings`."""
    return list(simulated_drive(seed, number, **settings))


def simulated_drive(seed: int, number: int, **settings: float) -> Iterator[TrueSweep]:
    """Yields sweeps of a simulated street one by one: a long drive does not fit into memory."""
    rate_hz = float(settings.get("rate_hz", 1e9 / INTERVAL_NS))
    street = SimulationSettings(seed=seed, duration_s=number / rate_hz, **settings)
    simulator = SweepSimulator(street)
    yield from (_simulated(simulator, index) for index in range(simulator.num_sweeps))


@dataclass(frozen=True, eq=False)
class World:
    """A random world: its seed, kind of lidar, what was drawn in a line, and its sweeps."""

    seed: int
    lidar: str
    text: str
    sweeps: list[TrueSweep]


def random_world(
    seed: int, num_sweeps: int, scenario: str = "random", conditions: str = "drawn"
) -> World:
    """Returns a random world; fewer sweeps are the first ones of more.

    `scenario` is any but `street`, `conditions` those of an adverse world. With hard turns, sweeps
    have turn rates.
    """
    settings = SimulationSettings(seed=seed, scenario=scenario, conditions=conditions)
    simulator = SweepSimulator(settings)
    sweeps = [_simulated(simulator, index) for index in range(num_sweeps)]
    if scenario == "turns":
        sweeps = list(_turning(simulator, sweeps))
    return World(seed, simulator.scene.sensor.kind, simulator.scene.text, sweeps)


def kept_world(
    seed: int, duration_s: float, scenario: str, folder: Path, conditions: str = "drawn"
) -> World:
    """Returns a random world from a folder, where it is kept; another simulator makes it anew.

    Raises:
        PermissionError: The folder belongs to another user: pickled objects are programs.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.stat().st_uid != os.getuid():
        raise PermissionError(f"{folder}: belongs to another user, name one of your own")
    path = folder / f"{_SIMULATOR}_{scenario}_{conditions}_{seed}_{duration_s:g}s.pickle"
    if path.exists():
        kept: World = pickle.loads(path.read_bytes())  # noqa: S301 - written by this program
        return kept
    drawn = {"seed": seed, "scenario": scenario, "conditions": conditions}
    num_sweeps = SweepSimulator(SimulationSettings(duration_s=duration_s, **drawn)).num_sweeps
    world = random_world(seed, num_sweeps, scenario, conditions)
    unfinished = path.with_suffix(f".{os.getpid()}")
    unfinished.write_bytes(pickle.dumps(world))
    unfinished.rename(path)
    return world


def _simulated(simulator: SweepSimulator, index: int) -> TrueSweep:
    item = simulator.sweep(index)
    times_ns = item.columns.get("t")
    times_s = None if times_ns is None else (times_ns / 1e9).astype(np.float32)
    sweep = Sweep(item.xyz, item.truth.stamp_ns, "lidar", times_s=times_s)
    return TrueSweep(sweep, item.pose, item.truth)


def _turning(simulator: SweepSimulator, sweeps: Iterable[TrueSweep]) -> Iterator[TrueSweep]:
    """The sweeps with the turn rates of their IMU."""
    rates = (
        StampedRate(FIRST_STAMP_NS + round(time_s * 1e9), np.array(rate))
        for time_s, *rate in simulator.turn_rates(IMU_HZ).tolist()
    )
    track = RateTrack(rates)
    for item in sweeps:
        yield replace(item, sweep=item.sweep.turning(track.around(item.sweep), np.eye(4)))


def triplet_at(sweeps: Sequence[TrueSweep], index: int) -> SweepTriplet:
    """Returns the triplet around a sweep, without odometry."""
    return SweepTriplet(*(item.sweep for item in sweeps[index - 1 : index + 2]))


def to_and_fro(items: Iterable[Item]) -> list[Item]:
    """Items forward and backward again, to play few sweeps for long.

    Only for slow drives such as KITTI 0005: at 8 m/s the registration takes a wrong place for about
    ten sweeps after each turn, which no robot makes within an interval.
    """
    forward = list(items)
    return [*forward, *forward[-2:0:-1]]
