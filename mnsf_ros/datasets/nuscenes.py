"""nuScenes: the lidar sweeps of a scene, all 20 in a second, with interpolated boxes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from mnsf_ros.datasets.errors import DatasetError
from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.nuscenes_boxes import Keyframe, boxes_at
from mnsf_ros.datasets.nuscenes_tables import (
    SweepRow,
    find_scene,
    read_keyframes,
    read_sweep_rows,
)
from mnsf_ros.datasets.source_files import as_type, read_float_rows, reading

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from mnsf_ros.datasets.read_options import ReadOptions

# Half of the vehicle's width and length: what the lidar on its roof sees closer than this, to its
# sides (x) and to its front and back (y), is the vehicle itself. The same as in OpenSceneFlow.
_OWN_X_M: Final = 1.730 / 2
_OWN_Y_M: Final = 4.084 / 2


def open_sequence(source: Path, options: ReadOptions) -> SweepSource:
    """Opens a scene.

    Args:
        source: The folder with `sweeps`, `samples` and the tables in `v1.0-…`, or the folder
            of the tables in it.
        options: `sequence`: name of the scene, needed if there are several.

    Raises:
        DatasetError: If something that is needed is missing or damaged.
    """
    tables = _tables_folder(source)
    keyframes = read_keyframes(tables, find_scene(tables, options.sequence))
    rows = read_sweep_rows(tables, keyframes.keys())
    if not rows:
        raise DatasetError(f"{tables}: has no lidar sweep of that scene")
    instants = list(keyframes.values())
    sweeps = (_sweep(tables, row, instants) for row in rows)
    return SweepSource("lidar_top", len(rows), sweeps)


def _tables_folder(source: Path) -> Path:
    if (source / "sample_data.json").is_file():
        return source
    found = [path.parent for path in sorted(source.glob("v1.0-*/sample_data.json"))]
    if len(found) != 1:
        names = ", ".join(path.name for path in found) or "none"
        raise DatasetError(
            f"{source}: expected one folder 'v1.0-…' with sample_data.json in it, found {names}"
        )
    return found[0]


def _sweep(tables: Path, row: SweepRow, keyframes: Sequence[Keyframe]) -> LabelledSweep:
    path = tables.parent / row.file_name
    points = read_float_rows(path, 5)
    boxes: tuple[Box, ...] | None = None
    # A split without labels has keyframes, but no object in any of them.
    if any(keyframe.annotations for keyframe in keyframes):
        with reading(tables / "sample_annotation.json", f"sweep of {row.micros} microseconds"):
            boxes = boxes_at(row.micros, keyframes, row.world_from_lidar)
    with reading(path):
        return LabelledSweep(
            stamp_ns=row.micros * 1000,
            xyz=np.ascontiguousarray(points[:, :3]),
            columns={"intensity": points[:, 3], "ring": as_type(points[:, 4], np.uint16)},
            pose=row.world_from_lidar,
            boxes=boxes,
            own_vehicle=(np.abs(points[:, 0]) < _OWN_X_M) & (np.abs(points[:, 1]) < _OWN_Y_M),
        )
