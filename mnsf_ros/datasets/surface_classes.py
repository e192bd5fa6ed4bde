# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The categories of the data sets as surface classes of the truth."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.recording.flow_truth import SurfaceClass

UNKNOWN: Final = 0


def _table(**names: str) -> dict[str, int]:
    """Returns category to class, for texts with the categories of each class."""
    return {
        name: int(SurfaceClass[surface.upper()])
        for surface, listed in names.items()
        for name in listed.split(", ")
    }


ARGOVERSE1: Final = _table(
    car="VEHICLE",
    pedestrian="PEDESTRIAN, STROLLER, WHEELCHAIR",
    cyclist="BICYCLE, BICYCLIST, MOPED, MOTORCYCLE, MOTORCYCLIST",
    large_vehicle="LARGE_VEHICLE, BUS, TRAILER, EMERGENCY_VEHICLE, SCHOOL_BUS",
    obstacle="ON_ROAD_OBSTACLE",
)
ARGOVERSE2: Final = _table(
    car="REGULAR_VEHICLE",
    pedestrian="OFFICIAL_SIGNALER, PEDESTRIAN, STROLLER, WHEELCHAIR",
    cyclist="BICYCLE, BICYCLIST, MOTORCYCLE, MOTORCYCLIST, WHEELED_DEVICE, WHEELED_RIDER",
    large_vehicle="ARTICULATED_BUS, BOX_TRUCK, BUS, LARGE_VEHICLE, RAILED_VEHICLE, SCHOOL_BUS, "
    "TRUCK, TRUCK_CAB, VEHICULAR_TRAILER",
    obstacle="BOLLARD, CONSTRUCTION_BARREL, CONSTRUCTION_CONE, MESSAGE_BOARD_TRAILER, "
    "MOBILE_PEDESTRIAN_CROSSING_SIGN, SIGN, STOP_SIGN, TRAFFIC_LIGHT_TRAILER",
    animal="ANIMAL, DOG",
)
KITTI: Final = _table(
    car="Car, Van",
    pedestrian="Pedestrian, Person (sitting)",
    cyclist="Cyclist",
    large_vehicle="Truck, Tram",
)
WAYMO: Final = {
    1: int(SurfaceClass.CAR),
    2: int(SurfaceClass.PEDESTRIAN),
    3: int(SurfaceClass.OBSTACLE),
    4: int(SurfaceClass.CYCLIST),
}
# Prefixes of categories; the first that fits counts.
_NUSCENES: Final = _table(
    cyclist="vehicle.bicycle, vehicle.motorcycle",
    car="vehicle.car",
    large_vehicle="vehicle.",
    pedestrian="human.",
    obstacle="movable_object., static_object.",
    animal="animal",
)


def nuscenes_class(name: str) -> int:
    """Returns the class of a nuScenes category, 0 if unknown."""
    return next((kind for prefix, kind in _NUSCENES.items() if name.startswith(prefix)), UNKNOWN)


_ARGOVERSE2_NAMES: Final = sorted(ARGOVERSE2)
# The usual category of each class that has one.
_ARGOVERSE2_NUMBERS: Final = {
    SurfaceClass[surface]: 1 + _ARGOVERSE2_NAMES.index(name)
    for surface, name in {
        "CAR": "REGULAR_VEHICLE",
        "PEDESTRIAN": "PEDESTRIAN",
        "CYCLIST": "BICYCLIST",
        "LARGE_VEHICLE": "LARGE_VEHICLE",
        "OBSTACLE": "BOLLARD",
        "ANIMAL": "ANIMAL",
    }.items()
}


def argoverse2_numbers(classes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Returns a category number of Argoverse 2 for each class (N,), 0 for the background."""
    table = np.zeros(256, dtype=np.uint8)
    for surface, number in _ARGOVERSE2_NUMBERS.items():
        table[surface] = number
    return table[classes]


def argoverse2_classes(numbers: NDArray[np.integer[Any]]) -> NDArray[np.uint8]:
    """Returns the class of each category number (N,) of Argoverse 2 flow labels.

    0 is the background, 1 to 30 are the categories by alphabet.

    Raises:
        ValueError: A number is out of range.
    """
    table = np.array([UNKNOWN, *(ARGOVERSE2[name] for name in _ARGOVERSE2_NAMES)], dtype=np.uint8)
    wrong = numbers[(numbers < 0) | (numbers >= len(table))]
    if len(wrong):
        raise ValueError(f"category number {wrong[0]}, expected 0 to {len(table) - 1}")
    classes: NDArray[np.uint8] = table[numbers]
    return classes
