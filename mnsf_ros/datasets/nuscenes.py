# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""nuScenes: the lidar sweeps of a scene, all 20 in a second, with interpolated boxes."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.datasets.json_entries import MICROSECONDS, TEXT, Kind, entry, numbers
from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import (
    as_type,
    choose,
    file_inside,
    read_float_rows,
    reading,
    regular,
)
from mnsf_ros.datasets.surface_classes import nuscenes_class
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import (
    FloatArray,
    interpolated_pose,
    invert,
    poses_from_quaternions,
    rigid_pose,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

_CHANNEL: Final = "LIDAR_TOP"
_CHUNK_CHARACTERS: Final = 1 << 20
# A thousand times what an object of the tables has. To look for the end of a damaged one in all of
# a table would take minutes.
_MAX_OBJECT_CHARACTERS: Final = 1 << 20
_BETWEEN: Final = " \t\r\n,"
# Half of the vehicle's width and length: what the lidar on its roof sees closer than this, to its
# sides (x) and to its front and back (y), is the vehicle itself. The same as in OpenSceneFlow.
_OWN_X_M: Final = 1.730 / 2
_OWN_Y_M: Final = 4.084 / 2
# The columns that are used; one that several tables have holds the same kind in all.
_KINDS: Final[Mapping[str, Kind]] = {
    **dict.fromkeys(("token", "scene_token", "sensor_token", "category_token", "name"), TEXT),
    **dict.fromkeys(("sample_token", "instance_token", "calibrated_sensor_token"), TEXT),
    **dict.fromkeys(("ego_pose_token", "channel", "filename"), TEXT),
    "timestamp": MICROSECONDS,
    "rotation": numbers(4),
    "translation": numbers(3),
    "size": numbers(3),
}


def json_rows(path: Path) -> Iterator[Any]:
    """Yields the entries of a list, of which only a part is in memory at a time.

    Raises:
        DatasetError: If the file is missing, cut short, or no list, or an entry is too long.
    """
    decoder = json.JSONDecoder()
    with reading(path), regular(path).open(encoding="utf-8") as file:
        text = file.read(_CHUNK_CHARACTERS).lstrip()
        if not text.startswith("["):
            raise ValueError("is no JSON list")
        position = 1
        while True:
            while position < len(text) and text[position] in _BETWEEN:
                position += 1
            if text.startswith("]", position):
                return
            try:
                row, position = decoder.raw_decode(text, position)
            except json.JSONDecodeError:
                # The rest of this object may be in the next chunk.
                if len(text) - position > _MAX_OBJECT_CHARACTERS:
                    raise ValueError(
                        f"an object is damaged or has over {_MAX_OBJECT_CHARACTERS} characters"
                    ) from None
                more = file.read(_CHUNK_CHARACTERS)
                if not more:
                    raise ValueError("the list has no end, the file is cut short") from None
                text, position = text[position:] + more, 0
                continue
            yield row


@dataclass(frozen=True, eq=False)
class Keyframe:
    """An instant (microseconds) with all objects in it, in the world: instance token -> box."""

    micros: int
    boxes: Mapping[str, Box]


def boxes_at(
    micros: int, keyframes: Sequence[Keyframe], world_from_lidar: FloatArray
) -> tuple[Box, ...] | None:
    """Returns the boxes in the frame of a sweep, those between two keyframes interpolated.

    Keyframes are in the order of time. Before the first one and after the last one there are no
    boxes: None. An object that is in only one of two keyframes is returned where it is there,
    with unknown motion.
    """
    after = bisect_right([keyframe.micros for keyframe in keyframes], micros)
    if after == 0:
        return None
    earlier = keyframes[after - 1]
    if earlier.micros == micros:
        boxes = list(earlier.boxes.values())
    elif after == len(keyframes):
        return None
    else:
        boxes = _boxes_between(earlier, keyframes[after], micros)
    lidar_from_world = invert(world_from_lidar)
    return tuple(replace(box, pose=lidar_from_world @ box.pose) for box in boxes)


def _boxes_between(earlier: Keyframe, later: Keyframe, micros: int) -> list[Box]:
    share = (micros - earlier.micros) / (later.micros - earlier.micros)
    boxes = []
    for instance, box in {**earlier.boxes, **later.boxes}.items():
        if instance in earlier.boxes and instance in later.boxes:
            pose = interpolated_pose(earlier.boxes[instance].pose, box.pose, share)
            boxes.append(replace(box, pose=pose))
        else:
            boxes.append(replace(box, track_id=None))
    return boxes


def _table(tables: Path, name: str, *columns: str) -> Iterator[tuple[Any, ...]]:
    """Yields the named columns of each row of a table."""
    path = tables / f"{name}.json"
    with reading(path):
        for row in json_rows(path):
            yield tuple(entry(row, column, _KINDS[column]) for column in columns)


def _poses(
    tables: Path, name: str, key: str, wanted: Collection[str]
) -> dict[str, NDArray[np.float64]]:
    """The poses (4, 4) in a table of the rows whose key is wanted, by their token."""
    rows = _table(tables, name, "token", key, "rotation", "translation")
    with reading(tables / f"{name}.json"):
        return {
            token: poses_from_quaternions(rotation, translation)
            for token, value, rotation, translation in rows
            if value in wanted
        }


def read_keyframes(tables: Path, scene: str) -> dict[str, Keyframe]:
    """Returns the annotated instants of a scene by their sample token, in the order of time."""
    samples = [
        (int(micros), token)
        for token, scene_token, micros in _table(
            tables, "sample", "token", "scene_token", "timestamp"
        )
        if scene_token == scene
    ]
    boxes: dict[str, dict[str, Box]] = {token: {} for _, token in sorted(samples)}
    categories = dict(_table(tables, "category", "token", "name"))
    instances = dict(_table(tables, "instance", "token", "category_token"))
    path = tables / "sample_annotation.json"
    columns = ("sample_token", "instance_token", "rotation", "translation", "size")
    for sample, instance, rotation, translation, size in _table(tables, path.stem, *columns):
        if sample not in boxes:
            continue
        if instance in boxes[sample]:
            raise DatasetError(f"{path}: instance {instance!r} occurs twice in sample {sample!r}")
        with reading(path, f"sample {sample!r}"):
            width, length, height = size
            boxes[sample][instance] = Box(
                pose=poses_from_quaternions(rotation, translation),
                size_m=np.array([length, width, height], dtype=np.float64),
                class_id=nuscenes_class(categories.get(instances.get(instance), "")),
                track_id=instance,
            )
    return {token: Keyframe(micros, boxes[token]) for micros, token in sorted(samples)}


@dataclass(frozen=True, eq=False)
class SweepRow:
    """One lidar sweep: where its file is, when and from where it was taken."""

    file_name: str
    micros: int
    world_from_lidar: NDArray[np.float64]


def read_sweep_rows(tables: Path, samples: Collection[str]) -> list[SweepRow]:
    """Returns the lidar sweeps of the samples and between them, in the order of time."""
    channels = _table(tables, "sensor", "token", "channel")
    sensors = {token for token, channel in channels if channel == _CHANNEL}
    mounts = _poses(tables, "calibrated_sensor", "sensor_token", sensors)
    entries = ("sample_token", "calibrated_sensor_token", "ego_pose_token", "timestamp", "filename")
    found = [
        row[1:]
        for row in _table(tables, "sample_data", *entries)
        if row[0] in samples and row[1] in mounts
    ]
    poses = _poses(tables, "ego_pose", "token", {ego for _, ego, _, _ in found})
    with reading(tables / "ego_pose.json"):
        sweeps = [
            SweepRow(name, int(micros), rigid_pose(poses[ego] @ mounts[mount]))
            for mount, ego, micros, name in found
        ]
    return sorted(sweeps, key=lambda sweep: sweep.micros)


def open_scene(source: Path, sequence: str | None = None) -> SweepSource:
    """Opens a scene, whose name is needed if there are several.

    The source has `sweeps`, `samples` and the tables in `v1.0-…`, or is the folder of the tables.
    """
    tables = _tables_folder(source)
    scenes = dict(_table(tables, "scene", "name", "token"))
    keyframes = read_keyframes(tables, scenes[choose(sequence, scenes, tables, "scene")])
    rows = read_sweep_rows(tables, keyframes)
    if not rows:
        raise DatasetError(f"{tables}: has no lidar sweep of that scene")
    sweeps = (_sweep(tables, row, list(keyframes.values())) for row in rows)
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
    with reading(tables / "sample_data.json"):
        path = file_inside(tables.parent, row.file_name)
    points = read_float_rows(path, 5)
    # A split without labels has keyframes, but no object in any of them.
    is_labelled = any(keyframe.boxes for keyframe in keyframes)
    with reading(path):
        return LabelledSweep(
            stamp_ns=row.micros * 1000,
            xyz=np.ascontiguousarray(points[:, :3]),
            columns={"intensity": points[:, 3], "ring": as_type(points[:, 4], np.uint16)},
            pose=row.world_from_lidar,
            boxes=boxes_at(row.micros, keyframes, row.world_from_lidar) if is_labelled else None,
            own_vehicle=(np.abs(points[:, 0]) < _OWN_X_M) & (np.abs(points[:, 1]) < _OWN_Y_M),
        )
