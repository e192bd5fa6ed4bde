# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What is called dynamic in the merged cloud of two lidars, and in that of each one.

    python benchmarks/several_lidars.py [--seeds 0 1] [--sweeps 16]

Two lidars on one robot take the same simulated street from different places and heights. Each
cloud is judged by itself, then both as one, as the node merges them.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.transforms import apply, planar_pose
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.simulation.routes import EgoMotion
from mnsf_ros.simulation.scene import build_scene
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SimulatedSweep, SweepSimulator
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

# Places of two lidars on the vehicle: x, y, z in metres from a point 1.73 m above the road.
ROOF_AND_BUMPER: Final = ((0.0, 0.0, 0.0), (2.0, 0.0, -1.0))
CORNERS: Final = ((1.5, 0.7, -0.8), (-1.5, -0.7, -0.8))
# Beyond it `online` calls nothing dynamic.
MAX_RANGE_M: Final = 80.0
# The first estimates have no past.
NUM_COLD: Final = 3
HEADER: Final = ("lidars", "cloud", "precision (%)", "recall (%)", "false (points per sweep)")


@dataclass(frozen=True)
class Pair:
    """Two lidars, and how they are merged.

    Attributes:
        places: Of both on the vehicle.
        below_m: How far the common frame is below the point that the places are counted from.
        is_apart: Whether the second lidar measures half a sweep later than the first.
    """

    places: tuple[Sequence[float], Sequence[float]]
    below_m: float = 0.0
    is_apart: bool = False


PAIRS: Final = {
    "roof and bumper": Pair(ROOF_AND_BUMPER),
    "frame on the ground": Pair(ROOF_AND_BUMPER, 1.73),
    "50 ms apart": Pair(ROOF_AND_BUMPER, is_apart=True),
    "two corners": Pair(CORNERS),
}


@dataclass(frozen=True)
class Mounted(EgoMotion):
    """The trip of a lidar at a place on the vehicle."""

    vehicle_from_lidar: NDArray[np.float64]

    def world_from_sensor(self, time_s: float) -> NDArray[np.float64]:
        """As in `EgoMotion`."""
        return super().world_from_sensor(time_s) @ self.vehicle_from_lidar


@dataclass(frozen=True, eq=False)
class Judged:
    """Points of one sweep: which lidar measured them, what moves, and what is called dynamic."""

    lidar: NDArray[np.int64]
    true: NDArray[np.bool_]
    said: NDArray[np.bool_]


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--sweeps", type=int, default=16)
    parser.add_argument("--beams", type=int, default=32)
    parser.add_argument("--columns", type=int, default=1024)
    parser.add_argument("--scenario", default="street")
    options = parser.parse_args()
    print(*HEADER, sep=" | ")
    for name, lidars in PAIRS.items():
        alone: dict[int, list[Judged]] = {0: [], 1: []}
        together: list[Judged] = []
        for seed in options.seeds:
            settings = SimulationSettings(
                seed=seed,
                duration_s=options.sweeps / 10,
                rate_hz=20 if lidars.is_apart else 10,
                num_beams=options.beams,
                num_columns=options.columns,
                scenario=options.scenario,
            )
            taken = [sweeps_at(settings, place) for place in lidars.places]
            if lidars.is_apart:
                taken = [sweeps[number::2] for number, sweeps in enumerate(taken)]
            for number, sweeps in enumerate(taken):
                clouds = [{number: sweep} for sweep in sweeps]
                alone[number] += judged(clouds, {number: np.eye(4)})
            poses = {
                number: pose_of((x, y, z + lidars.below_m))
                for number, (x, y, z) in enumerate(lidars.places)
            }
            together += judged([dict(enumerate(pair)) for pair in zip(*taken, strict=True)], poses)
        for number in (0, 1):
            for cloud, found in (("alone", alone[number]), ("merged", together)):
                row = (name, f"lidar {number + 1}, {cloud}", *figures(found, number))
                print(*row, sep=" | ", flush=True)


def pose_of(place: Sequence[float]) -> NDArray[np.float64]:
    """(4, 4) pose of a lidar at a place, not turned."""
    x, y, z = place
    return planar_pose(x, y, 0.0, z)


def sweeps_at(settings: SimulationSettings, place: Sequence[float]) -> list[SimulatedSweep]:
    """The sweeps of a lidar at a place on the vehicle, with noise of its own."""
    scene = build_scene(settings)
    ego = Mounted(scene.ego.trip, scene.ego.sway, pose_of(place))
    noisy = replace(settings, seed=settings.seed + round(1000 + 100 * place[0]))
    simulator = SweepSimulator(noisy, replace(scene, ego=ego))
    return [simulator.sweep(index) for index in range(settings.num_sweeps)]


def merged(cloud: Mapping[int, SimulatedSweep], poses: Mapping[int, NDArray[np.float64]]) -> Sweep:
    """One sweep of all lidars in the common frame, with the time of each point."""
    xyz = np.concatenate([apply(poses[number], item.xyz) for number, item in cloud.items()])
    first, *_ = stamps_ns = [item.stamp_ns for item in cloud.values()]
    lengths = [len(item.xyz) for item in cloud.values()]
    times_s = np.repeat((np.array(stamps_ns) - first) / 1e9, lengths).astype(np.float32)
    is_at_once = len(set(stamps_ns)) == 1
    return Sweep(
        xyz.astype(np.float32), first, "base_link", times_s=None if is_at_once else times_s
    )


def judged(
    clouds: Sequence[Mapping[int, SimulatedSweep]], poses: Mapping[int, NDArray[np.float64]]
) -> list[Judged]:
    """What `online` calls dynamic in clouds of one or more lidars, but in the first."""
    method, found = make_method("online", preset("online")), []
    sweeps = [merged(cloud, poses) for cloud in clouds]
    for index in range(1, len(sweeps) - 1):
        known = method.estimate(SweepTriplet(*sweeps[index - 1 : index + 2])).over_ground
        cloud = clouds[index]
        near = np.linalg.norm(sweeps[index].xyz, axis=1) < MAX_RANGE_M
        true = np.concatenate([item.dynamic for item in cloud.values()])
        said = np.zeros(len(true), bool) if known is None else known.dynamic
        lidar = np.repeat(list(cloud), [len(item.xyz) for item in cloud.values()])
        if index > NUM_COLD:
            found.append(Judged(lidar[near], true[near], said[near]))
    return found


def figures(found: Sequence[Judged], lidar: int) -> list[str]:
    """Precision, recall and false points of all sweeps, of the points of one lidar."""
    right = sum(np.count_nonzero((j.lidar == lidar) & j.true & j.said) for j in found)
    said = sum(np.count_nonzero((j.lidar == lidar) & j.said) for j in found)
    true = sum(np.count_nonzero((j.lidar == lidar) & j.true) for j in found)
    return [
        f"{100 * right / max(1, said):.1f}",
        f"{100 * right / max(1, true):.1f}",
        f"{(said - right) / max(1, len(found)):.0f}",
    ]


if __name__ == "__main__":
    main()
