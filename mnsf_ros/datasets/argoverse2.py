# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Argoverse 2 sensor data set: a log of Feather files, with boxes or with flow labels."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Floats
from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource, classes_of
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import poses_from_quaternions, rigid_pose
from mnsf_ros.sweeps_io.files import (
    as_type,
    columns_of,
    numbered_files,
    read_feather,
    reading,
    stacked,
)

_EXTRA: Final = {"intensity": ("intensity", np.float32), "laser_number": ("ring", np.uint16)}
_POSE: Final = ("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")
_NUM_POINTS: Final = "num_interior_pts"
_SIZE: Final = ("length_m", "width_m", "height_m")
ARGOVERSE2: Final = classes_of(
    car="REGULAR_VEHICLE",
    pedestrian="OFFICIAL_SIGNALER, PEDESTRIAN, STROLLER, WHEELCHAIR",
    cyclist="BICYCLE, BICYCLIST, MOTORCYCLE, MOTORCYCLIST, WHEELED_DEVICE, WHEELED_RIDER",
    large_vehicle="ARTICULATED_BUS, BOX_TRUCK, BUS, LARGE_VEHICLE, RAILED_VEHICLE, SCHOOL_BUS, "
    "TRUCK, TRUCK_CAB, VEHICULAR_TRAILER",
    obstacle="BOLLARD, CONSTRUCTION_BARREL, CONSTRUCTION_CONE, MESSAGE_BOARD_TRAILER, "
    "MOBILE_PEDESTRIAN_CROSSING_SIGN, SIGN, STOP_SIGN, TRAFFIC_LIGHT_TRAILER",
    animal="ANIMAL, DOG",
)
_NAMES: Final = sorted(ARGOVERSE2)
# Class of each category number: 0 is the background, 1 to 30 are the categories by alphabet.
_CLASSES: Final = np.array([0, *(ARGOVERSE2[name] for name in _NAMES)], np.uint8)
# Number of the most common category of each class; 0 for all other classes.
_COMMON = ("REGULAR_VEHICLE", "PEDESTRIAN", "BICYCLIST", "LARGE_VEHICLE", "BOLLARD", "ANIMAL")
_NUMBERS: Final = np.zeros(256, np.uint8)
_NUMBERS[[ARGOVERSE2[name] for name in _COMMON]] = [1 + _NAMES.index(name) for name in _COMMON]


def open_log(source: Path) -> SweepSource:
    """Opens the folder of a log, with `sensors/lidar` in it."""
    files = numbered_files(source / "sensors" / "lidar", "*.feather")
    pose_file, box_file = source / "city_SE3_egovehicle.feather", source / "annotations.feather"
    poses = _read_poses(pose_file)
    # Logs of the test split and of the lidar data set have none.
    boxes = _read_boxes(box_file) if box_file.is_file() else {}

    def sweeps() -> Iterator[LabelledSweep]:
        for stamp_ns, file in files.items():
            if stamp_ns not in poses:
                raise DatasetError(f"{pose_file}: has no pose of stamp {stamp_ns}")
            with reading(pose_file, f"pose of stamp {stamp_ns}"):
                pose = rigid_pose(poses[stamp_ns])
            yield _sweep(file, stamp_ns, pose, boxes.get(stamp_ns))

    return SweepSource("egovehicle", len(files), sweeps())


def _sweep(file: Path, stamp_ns: int, pose: Floats, boxes: tuple[Box, ...] | None) -> LabelledSweep:
    columns = read_feather(file, ("x", "y", "z", *_EXTRA, "offset_ns"))
    with reading(file):
        offset_s = as_type(columns["offset_ns"] * 1e-9, np.float32)
        return LabelledSweep(
            stamp_ns=stamp_ns,
            xyz=stacked(columns, "xyz"),
            columns={**columns_of(columns, _EXTRA), "time_offset": offset_s},
            pose=pose,
            boxes=boxes,
        )


def _read_poses(path: Path) -> dict[int, Floats]:
    columns = read_feather(path, ["timestamp_ns", *_POSE])
    with reading(path):
        return dict(zip(columns["timestamp_ns"].tolist(), _poses(columns), strict=True))


def _read_boxes(path: Path) -> dict[int, tuple[Box, ...]]:
    columns = read_feather(
        path, ["timestamp_ns", "track_uuid", "category", _NUM_POINTS, *_SIZE, *_POSE]
    )
    boxes: dict[int, tuple[Box, ...]] = defaultdict(tuple)
    for number, stamp_ns in enumerate(columns["timestamp_ns"].tolist()):
        row = {name: column[number] for name, column in columns.items()}
        with reading(path, f"sweep of stamp {stamp_ns}"):
            box = Box(
                pose=_poses(row),
                size_m=np.array([row[name] for name in _SIZE], dtype=np.float64),
                class_id=ARGOVERSE2.get(str(row["category"]), 0),
                track_id=str(row["track_uuid"]),
                hidden=row[_NUM_POINTS] == 0,
            )
        boxes[stamp_ns] += (box,)
    return boxes


def _poses(columns: Mapping[str, Floats]) -> Floats:
    numbers = np.stack([columns[name] for name in _POSE], axis=-1)
    return poses_from_quaternions(numbers[..., :4], numbers[..., 4:])


def argoverse2_numbers(classes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns a category number of Argoverse 2 for each class (N,), 0 for the background."""
    return _NUMBERS[classes]


def argoverse2_classes(numbers: NDArray[np.integer[Any]]) -> NDArray[np.uint8]:
    """Returns the class of each category number (N,) of Argoverse 2 flow labels.

    Raises:
        ValueError: A number is out of range.
    """
    wrong = numbers[(numbers < 0) | (numbers >= len(_CLASSES))]
    if len(wrong):
        raise ValueError(f"category number {wrong[0]}, expected 0 to {len(_CLASSES) - 1}")
    return _CLASSES[numbers]
