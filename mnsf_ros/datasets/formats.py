# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Options of `mnsf convert`: formats of data sets, and settings of their truth."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple


class Format(NamedTuple):
    """`MODULE:FUNCTION` that opens a source, its description, and whether it has sequences."""

    opener: str
    source: str
    has_sequences: bool = False


_NOT_RUN: Final = " (not run on foreign files)"

FORMATS: Final[Mapping[str, Format]] = {
    "kitti": Format("kitti:open_drive", "KITTI raw: folder of a drive, …_sync"),
    "argoverse2": Format("argoverse2:open_log", "Argoverse 2 sensor: folder of a log"),
    "argoverse1": Format("argoverse1:open_log", f"Argoverse 1 tracking: folder of a log{_NOT_RUN}"),
    "waymo": Format(
        "waymo:open_segment", f"Waymo Open v2: folder with lidar, lidar_pose, …{_NOT_RUN}", True
    ),
    "nuscenes": Format(
        "nuscenes:open_scene", "nuScenes: folder with sweeps, samples, v1.0-…", True
    ),
    "opensceneflow": Format("open_scene_flow:open_file", f"OpenSceneFlow: .h5 file{_NOT_RUN}"),
    "triplets": Format(
        "npz:open_triplets", "npz file (or folder) of NSFP, FNSF or MNSF: pc1, pc2, (pc3,) flow…"
    ),
    "sweeps": Format("npz:open_sweeps", "folder of npz sweeps, see docs/recordings.md"),
}


@dataclass(frozen=True)
class TruthSettings:
    """Settings of the truth."""

    # Growth of boxes in length, width and height, as in the data sets of NSFP, FNSF and MNSF.
    box_margin_m: float = 0.6
    unlabelled_static: bool = False  # points outside the labelled area are not unknown, but static
    # Points belong to boxes as in the official labels of Argoverse 2 (av2-api 01e6d958,
    # `Flow.from_sweep_pair`), see `official_box_of_points`; flow to a hidden box is then unknown.
    official: bool = False
