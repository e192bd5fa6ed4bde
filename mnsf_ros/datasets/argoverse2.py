# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Argoverse 2 sensor data set: a log of Feather files, with boxes or with flow labels."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import (
    as_type,
    columns_of,
    numbered_files,
    read_feather,
    reading,
    stacked,
)
from mnsf_ros.datasets.surface_classes import ARGOVERSE2, UNKNOWN, argoverse2_classes
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import poses_from_quaternions, rigid_pose

_EXTRA: Final = {"intensity": ("intensity", np.float32), "laser_number": ("ring", np.uint16)}
_POSE: Final = ("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")
_SIZE: Final = ("length_m", "width_m", "height_m")
_FLOW: Final = ("flow_tx_m", "flow_ty_m", "flow_tz_m")
# The names of a column in different tools, and their numbers of the background.
_VALID: Final = ("is_valid", "valid", "valid_0")
_DYNAMIC: Final = ("is_dynamic", "dynamic")
_CATEGORY: Final = {"category_indices": 0, "classes": 0, "classes_0": -1}


def open_log(source: Path, labels: Path | None = None) -> SweepSource:
    """Opens the folder of a log, with `sensors/lidar` in it.

    Scene flow labels of this log in the folder `labels`, files named by stamp, replace the boxes.
    """
    files = numbered_files(source / "sensors" / "lidar", "*.feather")
    flows = {} if labels is None else _flow_files(labels, files)
    annotations = source / "annotations.feather"
    # Logs of the test split and of the lidar data set have none.
    has_boxes = labels is None and annotations.is_file()
    boxes = _read_boxes(annotations) if has_boxes else {}
    pose_file = source / "city_SE3_egovehicle.feather"
    poses = _read_poses(pose_file)

    def sweeps() -> Iterator[LabelledSweep]:
        for stamp_ns, file in files.items():
            if stamp_ns not in poses:
                raise DatasetError(f"{pose_file}: has no pose of stamp {stamp_ns}")
            with reading(pose_file, f"pose of stamp {stamp_ns}"):
                pose = rigid_pose(poses[stamp_ns])
            flow_file = flows.get(stamp_ns)
            yield _sweep(file, stamp_ns, pose, boxes.get(stamp_ns), flow_file)

    return SweepSource("egovehicle", len(files), sweeps())


def _flow_files(folder: Path, stamps_ns: Collection[int]) -> dict[int, Path]:
    """Returns the labels of the sweeps by stamp: of all but the last, or only of some."""
    files = numbered_files(folder, "*.feather")
    for stamp_ns, file in files.items():
        if stamp_ns not in stamps_ns:
            raise DatasetError(f"{file}: its name is the stamp of no sweep")
    return files


def _sweep(
    file: Path,
    stamp_ns: int,
    pose: NDArray[np.float64],
    boxes: tuple[Box, ...] | None,
    flow_file: Path | None,
) -> LabelledSweep:
    columns = read_feather(file, ("x", "y", "z", *_EXTRA, "offset_ns"))
    with reading(file):
        xyz = stacked(columns, "xyz")
        offset_s = as_type(columns["offset_ns"] * 1e-9, np.float32)
        return LabelledSweep(
            stamp_ns=stamp_ns,
            xyz=xyz,
            columns={**columns_of(columns, _EXTRA), "time_offset": offset_s},
            pose=pose,
            boxes=boxes,
            **({} if flow_file is None else _read_flow(flow_file, len(xyz))),
        )


def _read_flow(path: Path, num_points: int) -> dict[str, Any]:
    """Returns the flow labels of a LabelledSweep by the names of its attributes."""
    columns = read_feather(path, _FLOW, (*_VALID, *_DYNAMIC, *_CATEGORY))
    valid, dynamic, category = (
        next((name for name in names if name in columns), None)
        for names in (_VALID, _DYNAMIC, _CATEGORY)
    )
    if valid is None:
        raise DatasetError(f"{path}: has no column {' or '.join(_VALID)}")
    if len(columns[valid]) != num_points:
        raise DatasetError(
            f"{path}: has {len(columns[valid])} rows for {num_points} points; labels "
            "of a subset of the points (as for the leaderboard) cannot be used"
        )
    with reading(path):
        found = {"flow": stacked(columns, _FLOW), "flow_valid": columns[valid].astype(bool)}
        if dynamic is not None:
            found["dynamic"] = columns[dynamic].astype(bool)
        if category is not None:
            numbers = as_type(columns[category], np.int64) - _CATEGORY[category]
            found["class_id"] = argoverse2_classes(numbers)
        return found


def _read_poses(path: Path) -> dict[int, NDArray[np.float64]]:
    columns = read_feather(path, ["timestamp_ns", *_POSE])
    with reading(path):
        return dict(zip(columns["timestamp_ns"].tolist(), _poses(columns), strict=True))


def _read_boxes(path: Path) -> dict[int, tuple[Box, ...]]:
    columns = read_feather(path, ["timestamp_ns", "track_uuid", "category", *_SIZE, *_POSE])
    boxes: dict[int, tuple[Box, ...]] = defaultdict(tuple)
    for number, stamp_ns in enumerate(columns["timestamp_ns"].tolist()):
        row = {name: column[number] for name, column in columns.items()}
        with reading(path, f"sweep of stamp {stamp_ns}"):
            box = Box(
                pose=_poses(row),
                size_m=np.array([row[name] for name in _SIZE], dtype=np.float64),
                class_id=ARGOVERSE2.get(str(row["category"]), UNKNOWN),
                track_id=str(row["track_uuid"]),
            )
        boxes[stamp_ns] += (box,)
    return boxes


def _poses(columns: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    numbers = np.stack([columns[name] for name in _POSE], axis=-1)
    return poses_from_quaternions(numbers[..., :4], numbers[..., 4:])
