# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Argoverse 1 tracking data set: a log of PLY sweeps with poses and boxes in JSON files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import columns_of, numbered_files, read_json, reading, stacked
from mnsf_ros.datasets.surface_classes import ARGOVERSE1, UNKNOWN
from mnsf_ros.errors import DatasetError, SweepFileError
from mnsf_ros.geometry.transforms import poses_from_quaternions, rigid_pose
from mnsf_ros.sweeps_io.ply import read_vertices

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

_EXTRA: Final = {"intensity": ("intensity", np.float32), "laser_number": ("ring", np.uint16)}
# What the annotators of a fully occluded object wrote down.
_OCCLUDED: Final = 100


def open_log(source: Path) -> SweepSource:
    """Opens a log with folders `lidar`, `poses`, and mostly `per_sweep_annotations_amodal`."""
    files = numbered_files(source / "lidar", "PC_*.ply", "PC_")
    sweeps = (_sweep(source, file, stamp_ns) for stamp_ns, file in files.items())
    return SweepSource("egovehicle", len(files), sweeps)


def _sweep(source: Path, file: Path, stamp_ns: int) -> LabelledSweep:
    try:
        points = read_vertices(file)
    except SweepFileError as error:
        raise DatasetError(str(error)) from error
    missing = [axis for axis in "xyz" if axis not in points]
    if missing:
        raise DatasetError(f"{file}: has no property {', '.join(missing)}")
    labels = source / "per_sweep_annotations_amodal" / f"tracked_object_labels_{stamp_ns}.json"
    with reading(file):
        return LabelledSweep(
            stamp_ns=stamp_ns,
            xyz=stacked(points, "xyz"),
            columns=columns_of(points, _EXTRA),
            pose=_read_pose(source / "poses" / f"city_SE3_egovehicle_{stamp_ns}.json"),
            # Logs of the test split have no such files.
            boxes=_read_boxes(labels) if labels.is_file() else None,
        )


def _read_pose(path: Path) -> NDArray[np.float64]:
    entry = read_json(path)
    with reading(path):
        return rigid_pose(poses_from_quaternions(entry["rotation"], entry["translation"]))


def _read_boxes(path: Path) -> tuple[Box, ...]:
    labels = read_json(path)
    with reading(path):
        return tuple(_box(label) for label in labels)


def _box(label: dict[str, Any]) -> Box:
    rotation, center = label["rotation"], label["center"]
    category = label.get("label_class") or ""
    name = category["name"] if isinstance(category, dict) else category
    return Box(
        pose=poses_from_quaternions(
            [rotation[axis] for axis in "wxyz"], [center[axis] for axis in "xyz"]
        ),
        size_m=np.array([label[side] for side in ("length", "width", "height")], np.float64),
        class_id=ARGOVERSE1.get(name, UNKNOWN),
        track_id=label["track_label_uuid"],
        hidden=label.get("occlusion", 0) == _OCCLUDED,
    )
