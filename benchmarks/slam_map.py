# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What a map of KISS-ICP is like with all points, and with the static ones of `~/flow/standing`.

    python benchmarks/slam_map.py [--scenarios street crowd] [--sweeps 100] [--document FILE]

Needs kiss-icp, the extra `benchmark`. Sweeps of simulated streets are registered; the map is every
voxel of 0.2 m with a point of at most 80 m range. A voxel that only moving points have touched is a
ghost.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP
from marked_section import add_document_option, replace_section
from numpy.typing import NDArray
from online_recordings import TrueSweep, simulated_sweeps

from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.report.text_table import TextTable
from mnsf_ros.sweeps.sweep import SweepTriplet

VOXEL_M: Final = 0.2
# Beyond the crop of the node nothing is called dynamic.
MAX_RANGE_M: Final = 80.0
HEADER: Final = [
    "scenario",
    "input",
    "ghost voxels",
    "ghosts left (%)",
    "static voxels kept (%)",
    "pose error (m)",
]


@dataclass(frozen=True, eq=False)
class Map:
    """Voxels of a map: those with a static point, those with moving points alone, pose error."""

    static: set[int]
    ghosts: set[int]
    pose_error_m: float


def main() -> None:
    """Prints the table, and writes it into a document."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenarios", nargs="+", default=["street", "crowd"])
    parser.add_argument("--sweeps", type=int, default=100)
    parser.add_argument("--beams", type=int, default=32)
    parser.add_argument("--columns", type=int, default=1024)
    add_document_option(parser)
    options = parser.parse_args()
    rows = []
    for scenario in options.scenarios:
        lidar = {"num_beams": options.beams, "num_columns": options.columns}
        sweeps = simulated_sweeps(0, options.sweeps, scenario=scenario, **lidar)
        found = static_points(sweeps)
        sweeps = sweeps[1:-1]
        everything = [np.ones(len(item.sweep.xyz), bool) for item in sweeps]
        whole, cleaned = (map_of(sweeps, kept) for kept in (everything, found))
        for name, made in (("all points", whole), ("~/flow/standing", cleaned)):
            rows.append([scenario, name, *row(made, whole)])
            print(*rows[-1], flush=True)
    table = TextTable(HEADER, rows, f"{options.beams} beams, {options.sweeps} sweeps")
    if options.document:
        replace_section(options.document, "slam-map", table.markdown())


def static_points(sweeps: Sequence[TrueSweep]) -> list[NDArray[np.bool_]]:
    """The points of each sweep but the first and the last that `online` calls static."""
    method, found = make_method("online", preset("online")), []
    for before, current, after in zip(sweeps, sweeps[1:], sweeps[2:], strict=False):
        known = method.estimate(SweepTriplet(before.sweep, current.sweep, after.sweep)).over_ground
        is_dynamic = np.zeros(len(current.sweep.xyz), bool) if known is None else known.dynamic
        found.append(~is_dynamic)
    return found


def map_of(sweeps: Sequence[TrueSweep], kept: Sequence[NDArray[np.bool_]]) -> Map:
    """Registers the kept points of sweeps and collects the voxels that they touch."""
    config = KISSConfig()
    config.data.max_range, config.data.min_range, config.data.deskew = MAX_RANGE_M, 1.0, False
    config.mapping.voxel_size = 1.0
    odometry, static, moving, errors_m = KissICP(config), set(), set(), []
    first = np.linalg.inv(sweeps[0].pose)
    for item, wanted in zip(sweeps, kept, strict=True):
        mask = wanted & (np.linalg.norm(item.sweep.xyz, axis=1) < MAX_RANGE_M)
        points = item.sweep.xyz[mask].astype(np.float64)
        odometry.register_frame(points, np.zeros(0))
        pose = odometry.last_pose
        errors_m.append(float(np.linalg.norm((pose - first @ item.pose)[:3, 3])))
        is_moving = np.zeros(len(mask), bool) if item.dynamic is None else item.dynamic
        placed = points @ pose[:3, :3].T + pose[:3, 3]
        static |= _voxels(placed[~is_moving[mask]])
        moving |= _voxels(placed[is_moving[mask]])
    return Map(static, moving - static, float(np.mean(errors_m)))


def row(made: Map, whole: Map) -> list[str]:
    """What a map has, beside that of all points."""
    return [
        f"{len(made.ghosts)}",
        f"{100 * len(made.ghosts) / max(1, len(whole.ghosts)):.1f}",
        f"{100 * len(made.static) / max(1, len(whole.static)):.2f}",
        f"{made.pose_error_m:.3f}",
    ]


def _voxels(points: NDArray[np.float64]) -> set[int]:
    """One number for each voxel, up to 200 km from the origin."""
    x, y, z = np.floor(points / VOXEL_M).astype(np.int64).T + (1 << 20)
    return set(np.unique((x << 42) | (y << 21) | z).tolist())


if __name__ == "__main__":
    main()
