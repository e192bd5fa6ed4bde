"""Argoverse 1 tracking data set: a log of PLY sweeps with poses and boxes in JSON files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import as_type, files_in, read_json, reading, stamp_in
from mnsf_ros.datasets.surface_classes import argoverse1_class
from mnsf_ros.errors import DatasetError, SweepFileError
from mnsf_ros.geometry.transforms import poses_from_quaternions, rigid_pose
from mnsf_ros.sweeps_io.ply import read_vertices

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from mnsf_ros.datasets.formats import ReadOptions

_PREFIX: Final = "PC_"
_EXTRA: Final = {"intensity": ("intensity", np.float32), "laser_number": ("ring", np.uint16)}
# What the annotators of a fully occluded object wrote down.
_OCCLUDED: Final = 100


def open_sequence(source: Path, _: ReadOptions) -> SweepSource:
    """Opens a log.

    Args:
        source: The folder of a log, with `lidar`, `poses` and mostly
            `per_sweep_annotations_amodal` in it.

    Raises:
        DatasetError: If there are no sweeps.
    """
    files = files_in(source / "lidar", f"{_PREFIX}*.ply")
    stamped = sorted((stamp_in(file.stem.removeprefix(_PREFIX), file), file) for file in files)
    sweeps = (_sweep(source, file, stamp_ns) for stamp_ns, file in stamped)
    return SweepSource("egovehicle", len(files), sweeps)


def _sweep(source: Path, file: Path, stamp_ns: int) -> LabelledSweep:
    points = _read_points(file)
    missing = [axis for axis in "xyz" if axis not in points]
    if missing:
        raise DatasetError(f"{file}: has no property {', '.join(missing)}")
    with reading(file):
        return LabelledSweep(
            stamp_ns=stamp_ns,
            xyz=as_type(np.stack([points[axis] for axis in "xyz"], axis=1), np.float32),
            columns={
                name: as_type(points[found], dtype)
                for found, (name, dtype) in _EXTRA.items()
                if found in points
            },
            pose=_read_pose(source / "poses" / f"city_SE3_egovehicle_{stamp_ns}.json"),
            boxes=_read_boxes(
                source / "per_sweep_annotations_amodal" / f"tracked_object_labels_{stamp_ns}.json"
            ),
        )


def _read_points(file: Path) -> dict[str, NDArray[Any]]:
    try:
        return read_vertices(file)
    except SweepFileError as error:
        raise DatasetError(str(error)) from error


def _read_pose(path: Path) -> NDArray[np.float64]:
    entry = read_json(path)
    with reading(path):
        return rigid_pose(poses_from_quaternions(entry["rotation"], entry["translation"]))


def _read_boxes(path: Path) -> tuple[Box, ...] | None:
    # Logs of the test split have no such files.
    if not path.is_file():
        return None
    labels = read_json(path)
    with reading(path):
        return tuple(_box(label) for label in labels)


def _box(label: dict[str, Any]) -> Box:
    rotation, center = label["rotation"], label["center"]
    category = label.get("label_class") or ""
    return Box(
        pose=poses_from_quaternions(
            [rotation[axis] for axis in "wxyz"], [center[axis] for axis in "xyz"]
        ),
        size_m=np.array([label[side] for side in ("length", "width", "height")], np.float64),
        class_id=argoverse1_class(category["name"] if isinstance(category, dict) else category),
        track_id=label["track_label_uuid"],
        hidden=label.get("occlusion", 0) == _OCCLUDED,
    )
