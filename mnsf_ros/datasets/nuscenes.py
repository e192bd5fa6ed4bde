# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""nuScenes: the lidar sweeps of a scene, all 20 in a second, with interpolated boxes."""

import json
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from mnsf_ros.arrays import AnyFloats, Floats
from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource, classes_of
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import (
    interpolated_pose,
    invert,
    poses_from_quaternions,
    rigid_pose,
)
from mnsf_ros.sweeps_io.files import as_type, choose, read_float_rows, reading

_CHANNEL: Final = "LIDAR_TOP"
_BETWEEN: Final = re.compile(r"[\s,]*")
# Half of the vehicle's width and length: closer points, to its sides (x) and to its front and back
# (y), are returns of the vehicle itself. The same as in OpenSceneFlow.
_OWN_X_M: Final = 1.730 / 2
_OWN_Y_M: Final = 4.084 / 2
# Prefixes of categories; the first that fits counts.
_NUSCENES: Final = classes_of(
    cyclist="vehicle.bicycle, vehicle.motorcycle",
    car="vehicle.car",
    large_vehicle="vehicle.",
    pedestrian="human.",
    obstacle="movable_object., static_object.",
    animal="animal",
)


def nuscenes_class(name: str) -> int:
    """Returns the class of a nuScenes category, 0 if unknown."""
    return next((kind for prefix, kind in _NUSCENES.items() if name.startswith(prefix)), 0)


def _json_rows(path: Path) -> Iterator[Any]:
    """Yields the entries of a JSON list one by one: tables have a gigabyte."""
    decoder = json.JSONDecoder()
    with reading(path):
        text = path.read_text("utf-8").strip()
        if not text.startswith("["):
            raise ValueError("is no JSON list")
        position = 1
        while not text.startswith("]", position := next(_BETWEEN.finditer(text, position)).end()):
            row, position = decoder.raw_decode(text, position)
            yield row


# Annotated instants in the order of time: microseconds to boxes in the world by their instance.
_Keyframes: TypeAlias = Mapping[int, Mapping[str, Box]]


def _boxes_at(
    micros: int, keyframes: _Keyframes, world_from_lidar: AnyFloats
) -> tuple[Box, ...] | None:
    """Returns the boxes in the frame of a sweep; None before the first keyframe, after the last."""
    earlier = max((moment for moment in keyframes if moment <= micros), default=None)
    later = min((moment for moment in keyframes if moment >= micros), default=None)
    if earlier is None or later is None:
        return None
    share = (micros - earlier) / max(later - earlier, 1)
    lidar_from_world, boxes = invert(world_from_lidar), []
    for instance, box in {**keyframes[earlier], **keyframes[later]}.items():
        # An object of only one of two keyframes keeps its place there, with unknown motion.
        pose, track_id = box.pose, None
        if instance in keyframes[earlier] and instance in keyframes[later]:
            pose = interpolated_pose(keyframes[earlier][instance].pose, pose, share)
            track_id = instance
        boxes.append(replace(box, pose=lidar_from_world @ pose, track_id=track_id))
    return tuple(boxes)


class _SweepRow(NamedTuple):
    """A lidar sweep: its time, its file and its pose."""

    micros: int
    file_name: str
    world_from_lidar: Floats


@dataclass(frozen=True)
class _Tables:
    folder: Path

    def rows(self, name: str, *columns: str) -> Iterator[tuple[Any, ...]]:
        """Yields some columns of each row of a table."""
        path = self.folder / f"{name}.json"
        with reading(path):
            for row in _json_rows(path):
                yield tuple(row[column] for column in columns)

    def poses(self, name: str, key: str, wanted: Collection[str]) -> dict[str, Floats]:
        """Returns the poses (4, 4) of the rows with a wanted key, by their token."""
        rows = self.rows(name, "token", key, "rotation", "translation")
        with reading(self.folder / f"{name}.json"):
            return {
                token: poses_from_quaternions(rotation, translation)
                for token, value, rotation, translation in rows
                if value in wanted
            }

    def samples(self, scene: str) -> dict[str, int]:
        """Returns the annotated instants of a scene: sample token to microseconds."""
        rows = self.rows("sample", "token", "scene_token", "timestamp")
        return {token: int(micros) for token, own, micros in rows if own == scene}

    def keyframes(self, samples: Mapping[str, int]) -> _Keyframes:
        """Returns the boxes at the samples."""
        found: dict[int, dict[str, Box]] = {micros: {} for micros in sorted(samples.values())}
        categories = dict(self.rows("category", "token", "name"))
        instances = dict(self.rows("instance", "token", "category_token"))
        columns = ("sample_token", "instance_token", "rotation", "translation", "size")
        path = self.folder / "sample_annotation.json"
        for sample, instance, rotation, translation, size in self.rows(path.stem, *columns):
            if sample not in samples:
                continue
            with reading(path, f"sample {sample!r}"):
                boxes = found[samples[sample]]
                if instance in boxes:
                    raise ValueError(f"instance {instance!r} occurs twice")
                width, length, height = size
                boxes[instance] = Box(
                    pose=poses_from_quaternions(rotation, translation),
                    size_m=np.array([length, width, height], dtype=np.float64),
                    class_id=nuscenes_class(categories.get(instances.get(instance), "")),
                    track_id=instance,
                )
        return found

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
                _SweepRow(int(micros), name, rigid_pose(poses[ego] @ mounts[mount]))
                for mount, ego, micros, name in found
            ]
        return sorted(sweeps, key=lambda sweep: sweep.micros)


def open_scene(source: Path, sequence: str | None = None) -> SweepSource:
    """Opens a scene, whose name is needed if there are several.

    The source has `sweeps`, `samples` and the tables in `v1.0-…`, or is the folder of the tables.
    """
    tables = _Tables(_tables_folder(source))
    scenes = dict(tables.rows("scene", "name", "token"))
    samples = tables.samples(scenes[choose(sequence, scenes, tables.folder, "scene")])
    keyframes, rows = tables.keyframes(samples), tables.sweeps(samples)
    if not rows:
        raise DatasetError(f"{tables.folder}: has no lidar sweep of that scene")
    sweeps = (_sweep(tables.folder, row, keyframes) for row in rows)
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


def _sweep(tables: Path, row: _SweepRow, keyframes: _Keyframes) -> LabelledSweep:
    micros, name, world_from_lidar = row
    if ".." in Path(name).parts or Path(name).is_absolute():
        raise DatasetError(f"{tables / 'sample_data.json'}: {name!r} leads out of the data set")
    path = tables.parent / name
    points = read_float_rows(path, 5)
    # A split without labels has keyframes, but no object in any of them.
    is_labelled = any(keyframes.values())
    with reading(path):
        return LabelledSweep(
            stamp_ns=micros * 1000,
            xyz=np.ascontiguousarray(points[:, :3]),
            columns={"intensity": points[:, 3], "ring": as_type(points[:, 4], np.uint16)},
            pose=world_from_lidar,
            boxes=_boxes_at(micros, keyframes, world_from_lidar) if is_labelled else None,
            own_vehicle=(np.abs(points[:, 0]) < _OWN_X_M) & (np.abs(points[:, 1]) < _OWN_Y_M),
        )
