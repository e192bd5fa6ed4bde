"""nuScenes: the lidar sweeps of a scene, all 20 in a second, with interpolated boxes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.datasets.errors import DatasetError
from mnsf_ros.datasets.labelled_sweep import LabelledSweep, SweepSource
from mnsf_ros.datasets.nuscenes_boxes import Keyframe, boxes_at
from mnsf_ros.datasets.nuscenes_tables import (
    SweepRow,
    find_scene,
    read_keyframes,
    read_sweep_rows,
)
from mnsf_ros.datasets.source_files import read_float_rows

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from mnsf_ros.datasets.read_options import ReadOptions


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
    sweeps = (_sweep(tables.parent, row, instants) for row in rows)
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


def _sweep(root: Path, row: SweepRow, keyframes: Sequence[Keyframe]) -> LabelledSweep:
    points = read_float_rows(root / row.file_name, 5)
    # A split without labels has keyframes, but no object in any of them.
    labelled = any(keyframe.annotations for keyframe in keyframes)
    return LabelledSweep(
        stamp_ns=row.micros * 1000,
        xyz=np.ascontiguousarray(points[:, :3]),
        columns={"intensity": points[:, 3], "ring": points[:, 4].astype(np.uint16)},
        pose=row.world_from_lidar,
        boxes=boxes_at(row.micros, keyframes, row.world_from_lidar) if labelled else None,
    )
