# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Argoverse 1 tracking data set: a log of PLY sweeps with poses and boxes in JSON files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mnsf_ros.datasets.json_entries import NUMBER, TEXT, Kind, entry, numbers
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
_OBJECT: Final = Kind("an object", lambda value: type(value) is dict)
_CATEGORY: Final = Kind(
    "a text, an object or null", lambda value: value is None or type(value) in (str, dict)
)
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
    row = read_json(path)
    with reading(path):
        rotation, translation = (
            entry(row, "rotation", numbers(4)),
            entry(row, "translation", numbers(3)),
        )
        return rigid_pose(poses_from_quaternions(rotation, translation))


def _read_boxes(path: Path) -> tuple[Box, ...]:
    labels = read_json(path)
    with reading(path):
        return tuple(_box(label) for label in labels)


def _box(label: Any) -> Box:  # noqa: ANN401
    rotation, center = entry(label, "rotation", _OBJECT), entry(label, "center", _OBJECT)
    # Some labels have neither.
    optional = {"label_class": None, "occlusion": 0, **label}
    category = entry(optional, "label_class", _CATEGORY)
    name = entry(category, "name", TEXT) if isinstance(category, dict) else category
    size = [entry(label, side, NUMBER) for side in ("length", "width", "height")]
    return Box(
        pose=poses_from_quaternions(
            [entry(rotation, axis, NUMBER) for axis in "wxyz"],
            [entry(center, axis, NUMBER) for axis in "xyz"],
        ),
        size_m=np.array(size, np.float64),
        class_id=ARGOVERSE1.get(name or "", UNKNOWN),
        track_id=entry(label, "track_label_uuid", TEXT),
        hidden=entry(optional, "occlusion", NUMBER) == _OCCLUDED,
    )
