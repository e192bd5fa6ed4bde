"""Argoverse 2 sensor data set: a log of Feather files, with boxes or with flow labels."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Final

import numpy as np

from mnsf_ros.datasets.argoverse2_labels import FlowLabels
from mnsf_ros.datasets.arrow_tables import read_feather
from mnsf_ros.datasets.errors import DatasetError
from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import as_type, files_in, reading, stamp_in
from mnsf_ros.datasets.surface_classes import argoverse2_class
from mnsf_ros.geometry.transforms import poses_from_quaternions, rigid_pose

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from mnsf_ros.datasets.read_options import ReadOptions

_POSE: Final = ("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")
_SIZE: Final = ("length_m", "width_m", "height_m")


def open_sequence(source: Path, options: ReadOptions) -> SweepSource:
    """Opens a log.

    Args:
        source: The folder of a log, with `sensors/lidar` in it.
        options: `labels`: folder of the scene flow labels of this log, to use instead of boxes.

    Raises:
        DatasetError: If something that is needed is missing or damaged.
    """
    files = files_in(source / "sensors" / "lidar", "*.feather")
    stamps_ns = [stamp_in(file.stem, file) for file in files]
    order = np.argsort(stamps_ns)
    files, stamps_ns = [files[i] for i in order], [stamps_ns[i] for i in order]
    labels = None if options.labels is None else FlowLabels(options.labels, stamps_ns)
    log = _Log(source, labels)
    sweeps = (log.sweep(file, stamp) for file, stamp in zip(files, stamps_ns, strict=True))
    return SweepSource("egovehicle", len(files), sweeps)


class _Log:
    """The parts of a log that do not belong to one sweep."""

    def __init__(self, source: Path, labels: FlowLabels | None) -> None:
        self._pose_file = source / "city_SE3_egovehicle.feather"
        columns = read_feather(self._pose_file, ["timestamp_ns", *_POSE])
        with reading(self._pose_file):
            poses = _poses(columns)
        self._poses = dict(zip(columns["timestamp_ns"].tolist(), poses, strict=True))
        self._labels = labels
        annotations = source / "annotations.feather"
        # Logs of the test split and of the lidar data set have none.
        self._boxes = _read_boxes(annotations) if labels is None and annotations.is_file() else {}

    def sweep(self, file: Path, stamp_ns: int) -> LabelledSweep:
        columns = read_feather(file, ("x", "y", "z", "intensity", "laser_number", "offset_ns"))
        if stamp_ns not in self._poses:
            raise DatasetError(f"{self._pose_file}: has no pose of stamp {stamp_ns}")
        with reading(self._pose_file, f"pose of stamp {stamp_ns}"):
            pose = rigid_pose(self._poses[stamp_ns])
        with reading(file):
            xyz = as_type(np.stack([columns[axis] for axis in "xyz"], axis=1), np.float32)
            return LabelledSweep(
                stamp_ns=stamp_ns,
                xyz=xyz,
                columns={
                    "intensity": as_type(columns["intensity"], np.float32),
                    "ring": as_type(columns["laser_number"], np.uint16),
                    "time_offset": as_type(columns["offset_ns"] * 1e-9, np.float32),
                },
                pose=pose,
                boxes=self._boxes.get(stamp_ns),
                given=None if self._labels is None else self._labels.of_sweep(stamp_ns, len(xyz)),
            )


def _read_boxes(path: Path) -> Mapping[int, tuple[Box, ...]]:
    columns = read_feather(path, ["timestamp_ns", "track_uuid", "category", *_SIZE, *_POSE])
    boxes: dict[int, list[Box]] = defaultdict(list)
    for row, stamp_ns in enumerate(columns["timestamp_ns"].tolist()):
        with reading(path, f"sweep of stamp {stamp_ns}"):
            box = Box(
                pose=_poses({name: columns[name][row] for name in _POSE}),
                size_m=np.array([columns[name][row] for name in _SIZE], dtype=np.float64),
                class_id=argoverse2_class(str(columns["category"][row])),
                track_id=str(columns["track_uuid"][row]),
            )
        boxes[stamp_ns].append(box)
    return {stamp_ns: tuple(found) for stamp_ns, found in boxes.items()}


def _poses(columns: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """(..., 4, 4) poses from columns (...)."""
    numbers = np.stack([columns[name] for name in _POSE], axis=-1)
    return poses_from_quaternions(numbers[..., :4], numbers[..., 4:])
