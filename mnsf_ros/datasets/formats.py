"""All formats that can be read, by the name a user calls them, and what to say about a source."""

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
class ReadOptions:
    """Options of the formats that take them.

    Attributes:
        sequence: Which sequence to read from a source that holds several.
        labels: Folder of labels that are kept apart from the sweeps.
    """

    sequence: str | None = None
    labels: Path | None = None


@dataclass(frozen=True)
class TruthSettings:
    """What truth is made of.

    Attributes:
        box_margin_m: By how much boxes grow in length, width and height, in total. The default
            is that of the data sets prepared for NSFP, FNSF and MNSF.
        unlabelled_static: Whether points where no labels reach count as standing still instead
            of as unknown.
    """

    box_margin_m: float = 0.6
    unlabelled_static: bool = False

    def __post_init__(self) -> None:
        """Checks the margin."""
        if not 0.0 <= self.box_margin_m <= 10.0:
            raise DatasetError(f"box margin is {self.box_margin_m} m, expected 0 to 10")


@dataclass(frozen=True)
class Format:
    """One layout of files.

    Attributes:
        module: Where `open_sequence` opens a source; imported when it is needed.
        source: What a source is, for the user.
        options: The fields of `ReadOptions` that it takes.
    """

    module: str
    source: str
    options: tuple[str, ...] = ()


FORMATS: Final[Mapping[str, Format]] = {
    "kitti": Format("kitti", "KITTI raw: folder of a drive, …_sync"),
    "argoverse2": Format("argoverse2", "Argoverse 2 sensor: folder of a log", ("labels",)),
    "argoverse1": Format("argoverse1", "Argoverse 1 tracking: folder of a log"),
    "waymo": Format(
        "waymo_parquet", "Waymo Open v2: folder with lidar, lidar_pose, …", ("sequence",)
    ),
    "waymo-v1": Format("waymo_records", "Waymo Open v1: .tfrecord file"),
    "nuscenes": Format("nuscenes", "nuScenes: folder with sweeps, samples, v1.0-…", ("sequence",)),
    "opensceneflow": Format("open_scene_flow", "OpenSceneFlow: .h5 file"),
    "triplets": Format(
        "npz_triplets", "npz file (or folder) of NSFP, FNSF or MNSF: pc1, pc2, (pc3,) flow…"
    ),
    "sweeps": Format("npz_sweeps", "folder of npz sweeps, see docs/recordings.md"),
}


def open_source(name: str, source: Path, options: ReadOptions | None = None) -> SweepSource:
    """Opens a sequence of a data set.

    Args:
        name: A key of `FORMATS`.
        source: Where it is.
        options: What else to say about it.

    Raises:
        DatasetError: If the format is unknown or does not take an option that is given, or if
            something that is needed is missing or damaged.
    """
    options = options or ReadOptions()
    if name not in FORMATS:
        raise DatasetError(f"format {name!r} is unknown, expected one of {', '.join(FORMATS)}")
    for option, value in vars(options).items():
        if value is not None and option not in FORMATS[name].options:
            raise DatasetError(f"format {name!r} takes no {option}, got {str(value)!r}")
    module = import_module(f"{__package__}.{FORMATS[name].module}")
    opened: SweepSource = module.open_sequence(source, options)
    return opened
