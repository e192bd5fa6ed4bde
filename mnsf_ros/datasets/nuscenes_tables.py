"""The rows of the nuScenes tables that belong to the lidar sweeps of one scene."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mnsf_ros.datasets.errors import DatasetError
from mnsf_ros.datasets.json_rows import json_rows
from mnsf_ros.datasets.nuscenes_boxes import Annotation, Keyframe
from mnsf_ros.datasets.source_files import reading
from mnsf_ros.datasets.surface_classes import nuscenes_class
from mnsf_ros.geometry.transforms import FloatArray, poses_from_quaternions, rigid_pose

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

_CHANNEL: Final = "LIDAR_TOP"


@dataclass(frozen=True, eq=False)
class SweepRow:
    """One lidar sweep: where its file is, when and from where it was taken."""

    file_name: str
    micros: int
    world_from_lidar: FloatArray


def find_scene(tables: Path, name: str | None) -> str:
    """Returns the token of the scene with this name, or if None of the only one.

    Raises:
        DatasetError: If there is none or several.
    """
    scenes = {row["name"]: row["token"] for row in _rows(tables, "scene")}
    if name is None and len(scenes) == 1:
        return str(next(iter(scenes.values())))
    if name in scenes:
        return str(scenes[name])
    wanted = "several scenes, name one" if name is None else f"no scene {name!r}"
    some = f"{', '.join(sorted(scenes)[:3])}{', …' if len(scenes) > 3 else ''}"
    raise DatasetError(f"{tables}: holds {wanted}; it has {some}")


def read_sweep_rows(tables: Path, sample_tokens: Collection[str]) -> list[SweepRow]:
    """Returns the lidar sweeps of the samples and between them, in the order of time."""
    sensors = {row["token"] for row in _rows(tables, "sensor") if row["channel"] == _CHANNEL}
    mounts = {
        row["token"]: row.pose
        for row in _rows(tables, "calibrated_sensor")
        if row["sensor_token"] in sensors
    }
    found = [
        row
        for row in _rows(tables, "sample_data")
        if row["sample_token"] in sample_tokens and row["calibrated_sensor_token"] in mounts
    ]
    wanted = {row["ego_pose_token"] for row in found}
    poses = {row["token"]: row.pose for row in _rows(tables, "ego_pose") if row["token"] in wanted}
    with reading(tables / "ego_pose.json"):
        sweeps = [
            SweepRow(
                file_name=row["filename"],
                micros=int(row["timestamp"]),
                world_from_lidar=rigid_pose(
                    poses[row["ego_pose_token"]] @ mounts[row["calibrated_sensor_token"]]
                ),
            )
            for row in found
        ]
    return sorted(sweeps, key=lambda sweep: sweep.micros)


def read_keyframes(tables: Path, scene_token: str) -> dict[str, Keyframe]:
    """Returns the annotated instants of a scene by their sample token, in the order of time."""
    samples = [row for row in _rows(tables, "sample") if row["scene_token"] == scene_token]
    micros = {row["token"]: int(row["timestamp"]) for row in samples}
    categories = {row["token"]: row["name"] for row in _rows(tables, "category")}
    annotations: dict[str, dict[str, Annotation]] = defaultdict(dict)
    instances: dict[str, str] = {}
    for row in _rows(tables, "instance"):
        instances[row["token"]] = categories.get(row["category_token"], "")
    for row in _rows(tables, "sample_annotation"):
        if row["sample_token"] in micros:
            instance = row["instance_token"]
            if instance in annotations[row["sample_token"]]:
                raise DatasetError(
                    f"{tables / 'sample_annotation.json'}: instance {instance!r} occurs twice in "
                    f"sample {row['sample_token']!r}"
                )
            width, length, height = row["size"]
            annotations[row["sample_token"]][instance] = Annotation(
                world_from_box=row.pose,
                size_m=np.array([length, width, height], dtype=np.float64),
                class_id=nuscenes_class(instances.get(instance, "")),
            )
    return {
        token: Keyframe(time, annotations[token])
        for token, time in sorted(micros.items(), key=lambda item: item[1])
    }


class _Row(dict[str, Any]):
    """A row that says which file it is from if there is something wrong with it."""

    def __init__(self, path: Path, row: dict[str, Any]) -> None:
        super().__init__(row)
        self._path = path

    def __missing__(self, name: str) -> Any:  # noqa: ANN401
        raise DatasetError(f"{self._path}: a row has no entry {name!r}")

    @property
    def pose(self) -> FloatArray:
        with reading(self._path):
            return poses_from_quaternions(self["rotation"], self["translation"])


def _rows(tables: Path, name: str) -> Iterator[_Row]:
    path = tables / f"{name}.json"
    return (_Row(path, row) for row in json_rows(path))
