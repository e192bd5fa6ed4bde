"""Tracked boxes of KITTI raw: `tracklet_labels.xml`."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from mnsf_ros.datasets.labelled_sweep import Box
from mnsf_ros.datasets.source_files import reading
from mnsf_ros.datasets.surface_classes import kitti_class
from mnsf_ros.geometry.transforms import planar_pose

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


def read_tracklets(path: Path) -> dict[int, tuple[Box, ...]]:
    """Returns the boxes in the lidar frame by the number of their sweep.

    Raises:
        DatasetError: If the file is missing, damaged or no tracklet file.
    """
    boxes: dict[int, list[Box]] = defaultdict(list)
    with reading(path):
        root = ElementTree.parse(path).getroot()
        tracklets = root.find("tracklets")
        if tracklets is None:
            raise ValueError("has no element 'tracklets'")
        for track_id, tracklet in enumerate(tracklets.findall("item")):
            for number, box in _boxes_of(path, tracklet, track_id):
                boxes[number].append(box)
    return {number: tuple(found) for number, found in boxes.items()}


def _boxes_of(
    path: Path, tracklet: ElementTree.Element, track_id: int
) -> Iterator[tuple[int, Box]]:
    height = _number(tracklet, "h")
    size = np.array([_number(tracklet, "l"), _number(tracklet, "w"), height])
    class_id = kitti_class(tracklet.findtext("objectType", ""))
    first = int(_number(tracklet, "first_frame"))
    for number, pose in enumerate(tracklet.findall("poses/item"), start=first):
        with reading(path, f"sweep {number}"):
            x, y, z, yaw = (_number(pose, name) for name in ("tx", "ty", "tz", "rz"))
            # A tracklet stands on its position, a Box has it in the middle.
            box = Box(planar_pose(x, y, yaw, z + height / 2), size, class_id, track_id)
        yield number, box


def _number(element: ElementTree.Element, name: str) -> float:
    text = element.findtext(name)
    if text is None:
        raise ValueError(f"a {element.tag!r} has no element {name!r}")
    return float(text)
