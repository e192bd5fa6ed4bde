# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""nuScenes: the lidar sweeps of a scene, all 20 in a second, with interpolated boxes."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import as_type, choose, file_inside, read_float_rows, reading
from mnsf_ros.datasets.surface_classes import nuscenes_class
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import (
    FloatArray,
    interpolated_pose,
    invert,
    poses_from_quaternions,
    rigid_pose,
)

_CHANNEL: Final = "LIDAR_TOP"
_CHUNK_CHARACTERS: Final = 1 << 20
_BETWEEN: Final = " \t\r\n,"
# Half of the vehicle's width and length: closer points, to its sides (x) and to its front and back
# (y), are returns of the vehicle itself. The same as in OpenSceneFlow.
_OWN_X_M: Final = 1.730 / 2
_OWN_Y_M: Final = 4.084 / 2


def json_rows(path: Path) -> Iterator[Any]:
    """Yields the entries of a JSON list, a part of the file in memory at a time.

    The tables of the whole data set have up to a gigabyte.

    Raises:
        DatasetError: The file is missing, cut short, or holds no list.
    """
    decoder = json.JSONDecoder()
    with reading(path), path.open(encoding="utf-8") as file:
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
                # The rest of this entry may be in the next part.
                more = file.read(_CHUNK_CHARACTERS)
                if not more:
                    raise ValueError("the list has no end, the file is cut short") from None
                text, position = text[position:] + more, 0
            else:
                yield row


@dataclass(frozen=True, eq=False)
class Keyframe:
    """An annotated instant (microseconds) with its boxes in the world: instance token to box."""

    micros: int
    boxes: Mapping[str, Box]


def boxes_at(
    micros: int, keyframes: Sequence[Keyframe], world_from_lidar: FloatArray
) -> tuple[Box, ...] | None:
    """Returns the boxes in the frame of a sweep, those between two keyframes interpolated.

    Keyframes are in the order of time. Before the first one and after the last one there are no
    boxes: None. An object of only one of two keyframes keeps its place there, with unknown motion.
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


@dataclass(frozen=True)
class _Tables:
    folder: Path

    def rows(self, name: str, *columns: str) -> Iterator[tuple[Any, ...]]:
        """Yields some columns of each row of a table."""
        path = self.folder / f"{name}.json"
        with reading(path):
            for row in json_rows(path):
                yield tuple(row[column] for column in columns)

    def poses(self, name: str, key: str, wanted: Collection[str]) -> dict[str, NDArray[np.float64]]:
        """Returns the poses (4, 4) of the rows with a wanted key, by their token."""
        rows = self.rows(name, "token", key, "rotation", "translation")
        with reading(self.folder / f"{name}.json"):
            return {
                token: poses_from_quaternions(rotation, translation)
                for token, value, rotation, translation in rows
                if value in wanted
            }

    def keyframes(self, scene: str) -> dict[str, Keyframe]:
        """Returns the annotated instants of a scene by their sample token, in the order of time."""
        samples = sorted(
            (int(micros), token)
            for token, own, micros in self.rows("sample", "token", "scene_token", "timestamp")
            if own == scene
        )
        boxes: dict[str, dict[str, Box]] = {token: {} for _, token in samples}
        categories = dict(self.rows("category", "token", "name"))
        instances = dict(self.rows("instance", "token", "category_token"))
        columns = ("sample_token", "instance_token", "rotation", "translation", "size")
        path = self.folder / "sample_annotation.json"
        for sample, instance, rotation, translation, size in self.rows(path.stem, *columns):
            if sample not in boxes:
                continue
            with reading(path, f"sample {sample!r}"):
                if instance in boxes[sample]:
                    raise ValueError(f"instance {instance!r} occurs twice")
                width, length, height = size
                boxes[sample][instance] = Box(
                    pose=poses_from_quaternions(rotation, translation),
                    size_m=np.array([length, width, height], dtype=np.float64),
                    class_id=nuscenes_class(categories.get(instances.get(instance), "")),
                    track_id=instance,
                )
        return {token: Keyframe(micros, boxes[token]) for micros, token in samples}

    def sweeps(self, samples: Collection[str]) -> list[_SweepRow]:
        """Returns the lidar sweeps of the samples and between them, in the order of time."""
        channels = self.rows("sensor", "token", "channel")
        sensors = {token for token, channel in channels if channel == _CHANNEL}
        mounts = self.poses("calibrated_sensor", "sensor_token", sensors)
        columns = ("calibrated_sensor_token", "ego_pose_token", "timestamp", "filename")
        found = [
            row
            for sample, *row in self.rows("sample_data", "sample_token", *columns)
            if sample in samples and row[0] in mounts
        ]
        poses = self.poses("ego_pose", "token", {ego for _, ego, _, _ in found})
        with reading(self.folder / "ego_pose.json"):
            sweeps = [
                _SweepRow(name, int(micros), rigid_pose(poses[ego] @ mounts[mount]))
                for mount, ego, micros, name in found
            ]
        return sorted(sweeps, key=lambda sweep: sweep.micros)


@dataclass(frozen=True, eq=False)
class _SweepRow:
    """A lidar sweep: its file, its time and its pose."""

    file_name: str
    micros: int
    world_from_lidar: NDArray[np.float64]


def open_scene(source: Path, sequence: str | None = None) -> SweepSource:
    """Opens a scene, whose name is needed if there are several.

    The source has `sweeps`, `samples` and the tables in `v1.0-…`, or is the folder of the tables.
    """
    tables = _Tables(_tables_folder(source))
    with reading(tables.folder):
        scenes = dict(tables.rows("scene", "name", "token"))
        scene = scenes[choose(sequence, scenes, tables.folder, "scene")]
        keyframes = tables.keyframes(scene)
        rows = tables.sweeps(keyframes)
    if not rows:
        raise DatasetError(f"{tables.folder}: has no lidar sweep of that scene")
    sweeps = (_sweep(tables.folder, row, list(keyframes.values())) for row in rows)
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


def _sweep(tables: Path, row: _SweepRow, keyframes: Sequence[Keyframe]) -> LabelledSweep:
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
