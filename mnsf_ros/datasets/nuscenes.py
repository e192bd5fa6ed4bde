"""nuScenes: the lidar sweeps of a scene, all 20 in a second, with interpolated boxes."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import as_type, read_float_rows, reading
from mnsf_ros.datasets.surface_classes import nuscenes_class
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import FloatArray, invert, poses_from_quaternions, rigid_pose

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from mnsf_ros.datasets.formats import ReadOptions

_CHUNK_CHARACTERS: Final = 1 << 20
_BETWEEN: Final = " \t\r\n,"


def json_rows(path: Path) -> Iterator[dict[str, Any]]:
    """Yields the objects of a list, of which only a part is in memory at a time.

    Raises:
        DatasetError: If the file is missing, cut short, or no list of objects.
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
                # The rest of this object may be in the next chunk.
                more = file.read(_CHUNK_CHARACTERS)
                if not more:
                    raise ValueError("the list has no end, the file is cut short") from None
                text, position = text[position:] + more, 0
                continue
            if not isinstance(row, dict):
                raise ValueError(f"the list holds {row!r}, expected objects")
            yield row


@dataclass(frozen=True, eq=False)
class Annotation:
    """A box at one instant: (4, 4) pose, (3,) length, width, height in metres, and surface."""

    world_from_box: FloatArray
    size_m: NDArray[np.float64]
    class_id: int


@dataclass(frozen=True, eq=False)
class Keyframe:
    """An instant (microseconds) with all objects in it: instance token -> box."""

    micros: int
    annotations: Mapping[str, Annotation]


def boxes_at(
    micros: int, keyframes: Sequence[Keyframe], world_from_lidar: FloatArray
) -> tuple[Box, ...] | None:
    """Returns the boxes in the frame of a sweep, those between two keyframes interpolated.

    Centers move straight and evenly, headings turn evenly. An object that is in only one of
    the two keyframes is returned where it is there, with unknown motion.

    Args:
        micros: Time of the sweep.
        keyframes: In the order of time.
        world_from_lidar: (4, 4) pose of the sweep.

    Returns:
        None before the first keyframe and after the last.
    """
    after = bisect_right([keyframe.micros for keyframe in keyframes], micros)
    if after == 0:
        return None
    earlier = keyframes[after - 1]
    lidar_from_world = invert(world_from_lidar)
    if earlier.micros == micros:
        return tuple(
            Box(lidar_from_world @ one.world_from_box, one.size_m, one.class_id, instance)
            for instance, one in earlier.annotations.items()
        )
    if after == len(keyframes):
        return None
    return _boxes_between(earlier, keyframes[after], micros, lidar_from_world)


def _boxes_between(
    earlier: Keyframe, later: Keyframe, micros: int, lidar_from_world: FloatArray
) -> tuple[Box, ...]:
    share = (micros - earlier.micros) / (later.micros - earlier.micros)
    boxes = []
    for instance in {**earlier.annotations, **later.annotations}:
        first, last = earlier.annotations.get(instance), later.annotations.get(instance)
        known = last or first
        if known is None:
            continue
        pose, track_id = known.world_from_box, None
        if first is not None and last is not None:
            pose, track_id = _between(first.world_from_box, last.world_from_box, share), instance
        boxes.append(Box(lidar_from_world @ pose, known.size_m, known.class_id, track_id))
    return tuple(boxes)


def _between(first: FloatArray, last: FloatArray, share: float) -> FloatArray:
    pose = np.eye(4)
    pose[:3, 3] = (1 - share) * first[:3, 3] + share * last[:3, 3]
    turns = Rotation.from_matrix(np.stack([first[:3, :3], last[:3, :3]]))
    pose[:3, :3] = Slerp([0.0, 1.0], turns)(share).as_matrix()
    return pose


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
