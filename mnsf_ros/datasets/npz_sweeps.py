"""The project's own layout: a folder of npz files with one sweep each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.datasets.labelled_sweep import Box, GivenFlow, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import as_type, files_in, read_json, read_npz, reading
from mnsf_ros.datasets.surface_classes import kitti_class
from mnsf_ros.geometry.transforms import planar_pose, rigid_pose

if TYPE_CHECKING:
    from pathlib import Path

    from mnsf_ros.datasets.formats import ReadOptions

_COLUMNS: Final = {"intensity": np.float32, "ring": np.uint16, "time_offset": np.float32}


def open_sequence(source: Path, _: ReadOptions) -> SweepSource:
    """Opens a folder of sweeps.

    Args:
        source: A folder of npz files, by name in the order of time, and possibly `boxes.json`.

    Raises:
        DatasetError: If there is no sweep, or the boxes are damaged.
    """
    files = files_in(source, "*.npz")
    box_file = source / "boxes.json"
    boxes = _read_boxes(box_file) if box_file.is_file() else {}
    sweeps = (_sweep(file, boxes.get(number)) for number, file in enumerate(files))
    return SweepSource("lidar", len(files), sweeps)


def _sweep(file: Path, boxes: tuple[Box, ...] | None) -> LabelledSweep:
    arrays = read_npz(file, ("xyz", "stamp_ns"))
    with reading(file):
        return LabelledSweep(
            stamp_ns=int(arrays["stamp_ns"]),
            xyz=as_type(arrays["xyz"], np.float32),
            columns={
                name: as_type(arrays[name], dtype)
                for name, dtype in _COLUMNS.items()
                if name in arrays
            },
            pose=rigid_pose(arrays["pose"]) if "pose" in arrays else None,
            boxes=boxes,
            given=_given(arrays) if "flow" in arrays else None,
            labelled=_flags(arrays, "label_valid"),
            ground=_flags(arrays, "is_ground"),
        )


def _given(arrays: Mapping[str, NDArray[Any]]) -> GivenFlow:
    valid = _flags(arrays, "flow_valid")
    return GivenFlow(
        flow=as_type(arrays["flow"], np.float32),
        valid=np.ones(len(arrays["flow"]), dtype=bool) if valid is None else valid,
        dynamic=_flags(arrays, "is_dynamic"),
    )


def _flags(arrays: Mapping[str, NDArray[Any]], name: str) -> NDArray[np.bool_] | None:
    return as_type(arrays[name], bool) if name in arrays else None


def _read_boxes(path: Path) -> dict[int, tuple[Box, ...]]:
    """Boxes by the number of the sweep, counted from 0."""
    content = read_json(path)
    boxes: dict[int, tuple[Box, ...]] = {}
    with reading(path):
        for number, entries in content.items():
            with reading(path, f"sweep {number}"):
                boxes[int(number)] = tuple(_box(entry) for entry in entries)
    return boxes


def _box(entry: Mapping[str, Any]) -> Box:
    x, y, z = entry["center"]
    return Box(
        pose=planar_pose(x, y, entry["yaw"], z),
        size_m=np.asarray(entry["size"], dtype=np.float64),
        class_id=kitti_class(entry["cls"]),
        track_id=entry["track_id"],
    )
