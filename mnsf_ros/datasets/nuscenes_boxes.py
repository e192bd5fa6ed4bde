"""Boxes of nuScenes between the instants at which they were annotated."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from mnsf_ros.datasets.labelled_sweep import Box
from mnsf_ros.geometry.transforms import FloatArray, invert

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Annotation:
    """A box at one instant: (4, 4) pose, (3,) length, width, height in meters, and surface."""

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
