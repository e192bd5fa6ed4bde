# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The formats of data sets by name.

Each opener raises a DatasetError if a needed file is missing or damaged; so does reading the
sweeps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mnsf_ros.errors import DatasetError

if TYPE_CHECKING:
    from mnsf_ros.datasets.labelled_sweep import SweepSource


@dataclass(frozen=True)
class TruthSettings:
    """Settings of the truth.

    Attributes:
        box_margin_m: Growth of the boxes in length, width and height, metres. The default is that
            of the data sets prepared for NSFP, FNSF and MNSF.
        unlabelled_static: Whether points outside the labelled area are static instead of unknown.
    """

    box_margin_m: float = 0.6
    unlabelled_static: bool = False

    def __post_init__(self) -> None:
        """Checks the margin."""
        if not 0.0 <= self.box_margin_m <= 10.0:
            raise DatasetError(f"box margin is {self.box_margin_m} m, expected 0 to 10")


@dataclass(frozen=True)
class Format:
    """One format of a data set.

    Attributes:
        place: Module and function that opens a source; imported on first use.
        source: Description of a source for the user.
        options: Supported options of `open_source`.
    """

    place: str
    source: str
    options: tuple[str, ...] = ()


FORMATS: Final[Mapping[str, Format]] = {
    "kitti": Format("kitti:open_drive", "KITTI raw: folder of a drive, …_sync"),
    "argoverse2": Format("argoverse2:open_log", "Argoverse 2 sensor: folder of a log", ("labels",)),
    "argoverse1": Format("argoverse1:open_log", "Argoverse 1 tracking: folder of a log"),
    "waymo": Format(
        "waymo:open_segment", "Waymo Open v2: folder with lidar, lidar_pose, …", ("sequence",)
    ),
    "nuscenes": Format(
        "nuscenes:open_scene", "nuScenes: folder with sweeps, samples, v1.0-…", ("sequence",)
    ),
    "opensceneflow": Format("open_scene_flow:open_file", "OpenSceneFlow: .h5 file"),
    "triplets": Format(
        "npz:open_triplets", "npz file (or folder) of NSFP, FNSF or MNSF: pc1, pc2, (pc3,) flow…"
    ),
    "sweeps": Format("npz:open_sweeps", "folder of npz sweeps, see docs/recordings.md"),
}


def open_source(
    name: str, source: Path, *, sequence: str | None = None, labels: Path | None = None
) -> SweepSource:
    """Opens a sequence of a data set whose format is a key of `FORMATS`.

    A source with several sequences needs the name of the `sequence`. `labels` is a separate folder
    of labels.

    Raises:
        DatasetError: The format is unknown or does not support a given option, or a needed file is
            missing or damaged.
    """
    if name not in FORMATS:
        raise DatasetError(f"format {name!r} is unknown, expected one of {', '.join(FORMATS)}")
    given = {"sequence": sequence, "labels": labels}
    options = {option: value for option, value in given.items() if value is not None}
    for option, value in options.items():
        if option not in FORMATS[name].options:
            raise DatasetError(f"format {name!r} takes no {option}, got {str(value)!r}")
    module, _, function = FORMATS[name].place.partition(":")
    opener = getattr(import_module(f"{__package__}.{module}"), function)
    opened: SweepSource = opener(source, **options)
    return opened
