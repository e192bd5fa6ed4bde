"""Argoverse 2 sensor data set: a log of Feather files, with boxes or with flow labels."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Final

import numpy as np

from mnsf_ros.datasets.arrow_tables import feather_columns, read_feather
from mnsf_ros.datasets.labelled_sweep import Box, GivenFlow, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import as_type, files_in, reading, stamp_in
from mnsf_ros.datasets.surface_classes import argoverse2_class, argoverse2_classes
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import poses_from_quaternions, rigid_pose

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from mnsf_ros.datasets.formats import ReadOptions

_FLOW: Final = ("flow_tx_m", "flow_ty_m", "flow_tz_m")
# Names of the same thing in different tools, and the number of the background in each.
_VALID: Final = ("is_valid", "valid", "valid_0")
_DYNAMIC: Final = ("is_dynamic", "dynamic")
_CATEGORY: Final = {"category_indices": 0, "classes": 0, "classes_0": -1}


class FlowLabels:
    """A folder with a Feather file for each sweep but the last, or for the first ones only.

    Files are named by the stamp of their sweep, or counted from 0 or 1, as some tools do.
    """

    def __init__(self, folder: Path, stamps_ns: list[int]) -> None:
        """Finds the file of every sweep.

        Args:
            folder: The folder of a log's labels.
            stamps_ns: Stamps of all sweeps of the log, in order.

        Raises:
            DatasetError: If there is none, or names and stamps do not fit.
        """
        self._folder = folder
        self._files = {stamp_in(file.stem, file): file for file in files_in(folder, "*.feather")}
        unknown = sorted(self._files.keys() - set(stamps_ns))
        if not unknown:
            return
        counts = sorted(self._files)
        num_files = len(counts)
        is_counted = counts[0] in (0, 1) and counts[-1] - counts[0] == num_files - 1
        if not is_counted or num_files >= len(stamps_ns):
            raise DatasetError(
                f"{folder}: {self._files[unknown[0]].name!r} has the stamp of no sweep, and "
                f"{num_files} files cannot be counted off against {len(stamps_ns)} sweeps"
            )
        ordered = [self._files[count] for count in counts]
        self._files = dict(zip(stamps_ns, ordered, strict=False))

    def of_sweep(self, stamp_ns: int, num_points: int) -> GivenFlow | None:
        """Returns the flow of a sweep, None if it has no labels.

        Raises:
            DatasetError: If its file is damaged, or has not one row for each point.
        """
        path = self._files.get(stamp_ns)
        if path is None:
            return None
        found = feather_columns(path)
        valid_name = next((name for name in _VALID if name in found), _VALID[0])
        dynamic_name = next((name for name in _DYNAMIC if name in found), None)
        category_name = next((name for name in _CATEGORY if name in found), None)
        optional = [name for name in (dynamic_name, category_name) if name is not None]
        columns = read_feather(path, [*_FLOW, valid_name, *optional])
        if len(columns[valid_name]) != num_points:
            raise DatasetError(
                f"{path}: has {len(columns[valid_name])} rows for {num_points} points; labels "
                "of a subset of the points (as for the leaderboard) cannot be used"
            )
        class_id = None
        if category_name is not None:
            with reading(path):
                numbers = as_type(columns[category_name], np.int64) - _CATEGORY[category_name]
                class_id = argoverse2_classes(numbers)
        with reading(path):
            return GivenFlow(
                flow=as_type(np.stack([columns[name] for name in _FLOW], axis=1), np.float32),
                valid=columns[valid_name].astype(bool),
                dynamic=None if dynamic_name is None else columns[dynamic_name].astype(bool),
                class_id=class_id,
            )


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
