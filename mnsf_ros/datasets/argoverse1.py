# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Argoverse 1 tracking data set: a log of PLY sweeps with poses and boxes in JSON files."""

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Floats
from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource, classes_of
from mnsf_ros.geometry.transforms import poses_from_quaternions, rigid_pose
from mnsf_ros.sweeps_io.files import columns_of, numbered_files, read_json, reading, stacked

_EXTRA: Final = {"intensity": ("intensity", np.float32), "laser_number": ("ring", np.uint16)}
_PLY_TYPES: Final = {"uchar": "u1", "ushort": "<u2", "int": "<i4", "float": "<f4", "double": "<f8"}
# The annotators' value for a fully occluded object.
_OCCLUDED: Final = 100
ARGOVERSE1: Final = classes_of(
    car="VEHICLE",
    pedestrian="PEDESTRIAN, STROLLER, WHEELCHAIR",
    cyclist="BICYCLE, BICYCLIST, MOPED, MOTORCYCLE, MOTORCYCLIST",
    large_vehicle="LARGE_VEHICLE, BUS, TRAILER, EMERGENCY_VEHICLE, SCHOOL_BUS",
    obstacle="ON_ROAD_OBSTACLE",
)


def open_log(source: Path) -> SweepSource:
    """Opens a log with folders `lidar`, `poses`, and mostly `per_sweep_annotations_amodal`."""
    files = numbered_files(source / "lidar", "PC_*.ply", "PC_")
    sweeps = (_sweep(source, file, stamp_ns) for stamp_ns, file in files.items())
    return SweepSource("egovehicle", len(files), sweeps)


def _sweep(source: Path, file: Path, stamp_ns: int) -> LabelledSweep:
    labels = source / "per_sweep_annotations_amodal" / f"tracked_object_labels_{stamp_ns}.json"
    with reading(file):
        points = _read_points(file)
        return LabelledSweep(
            stamp_ns=stamp_ns,
            xyz=stacked(points, "xyz"),
            columns=columns_of(points, _EXTRA),
            pose=_read_pose(source / "poses" / f"city_SE3_egovehicle_{stamp_ns}.json"),
            # Logs of the test split have no such files.
            boxes=_read_boxes(labels) if labels.is_file() else None,
        )


def _read_points(path: Path) -> dict[str, NDArray[Any]]:
    """Returns the properties (N,) of the vertices, which come first in a binary PLY file."""
    header, end, body = path.read_bytes().partition(b"end_header\n")
    is_known, num_points, fields = False, 0, []
    for words in map(str.split, header.decode("ascii").splitlines()):
        match words:
            case ["format", "binary_little_endian", _]:
                is_known = True
            case ["element", "vertex", number]:
                num_points = int(number)
            case ["element", *_]:
                break
            case ["property", kind, name]:
                fields.append((name, _PLY_TYPES[kind]))
            case ["property", *_]:
                raise ValueError("its vertices have lists")
    if not (end and is_known and fields):
        raise ValueError("expected a little-endian PLY file that begins with its vertices")
    points = np.frombuffer(body, np.dtype(fields), num_points)
    return {name: points[name] for name, _ in fields}


def _read_pose(path: Path) -> Floats:
    row = read_json(path, dict)
    with reading(path):
        return rigid_pose(poses_from_quaternions(row["rotation"], row["translation"]))


def _read_boxes(path: Path) -> tuple[Box, ...]:
    labels = read_json(path, list)
    with reading(path):
        return tuple(_box(label) for label in labels)


def _box(label: dict[str, Any]) -> Box:
    rotation, center = label["rotation"], label["center"]
    category = label.get("label_class")  # a name, an object with a name, or missing
    name = category["name"] if isinstance(category, dict) else category
    sides = ("length", "width", "height")
    return Box(
        pose=poses_from_quaternions(
            [rotation[axis] for axis in "wxyz"], [center[axis] for axis in "xyz"]
        ),
        size_m=np.array([label[side] for side in sides], np.float64),
        class_id=ARGOVERSE1.get(name or "", 0),
        track_id=label["track_label_uuid"],
        hidden=label.get("occlusion") == _OCCLUDED,
    )
