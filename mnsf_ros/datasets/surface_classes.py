"""The categories of the data sets in the project's own table of surfaces."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mnsf_ros.recording.flow_truth import SurfaceClass

if TYPE_CHECKING:
    from numpy.typing import NDArray

UNKNOWN: Final = 0
_CAR, _PERSON = int(SurfaceClass.CAR), int(SurfaceClass.PEDESTRIAN)
_CYCLIST, _LARGE = int(SurfaceClass.CYCLIST), int(SurfaceClass.LARGE_VEHICLE)
_OBSTACLE, _ANIMAL = int(SurfaceClass.OBSTACLE), int(SurfaceClass.ANIMAL)

# In the order of the numbers that flow labels use, from 1; 0 is the background.
_ARGOVERSE2: Final = {
    "ANIMAL": _ANIMAL,
    "ARTICULATED_BUS": _LARGE,
    "BICYCLE": _CYCLIST,
    "BICYCLIST": _CYCLIST,
    "BOLLARD": _OBSTACLE,
    "BOX_TRUCK": _LARGE,
    "BUS": _LARGE,
    "CONSTRUCTION_BARREL": _OBSTACLE,
    "CONSTRUCTION_CONE": _OBSTACLE,
    "DOG": _ANIMAL,
    "LARGE_VEHICLE": _LARGE,
    "MESSAGE_BOARD_TRAILER": _OBSTACLE,
    "MOBILE_PEDESTRIAN_CROSSING_SIGN": _OBSTACLE,
    "MOTORCYCLE": _CYCLIST,
    "MOTORCYCLIST": _CYCLIST,
    "OFFICIAL_SIGNALER": _PERSON,
    "PEDESTRIAN": _PERSON,
    "RAILED_VEHICLE": _LARGE,
    "REGULAR_VEHICLE": _CAR,
    "SCHOOL_BUS": _LARGE,
    "SIGN": _OBSTACLE,
    "STOP_SIGN": _OBSTACLE,
    "STROLLER": _PERSON,
    "TRAFFIC_LIGHT_TRAILER": _OBSTACLE,
    "TRUCK": _LARGE,
    "TRUCK_CAB": _LARGE,
    "VEHICULAR_TRAILER": _LARGE,
    "WHEELCHAIR": _PERSON,
    "WHEELED_DEVICE": _CYCLIST,
    "WHEELED_RIDER": _CYCLIST,
}
_ARGOVERSE1: Final = {
    "VEHICLE": _CAR,
    "PEDESTRIAN": _PERSON,
    "ON_ROAD_OBSTACLE": _OBSTACLE,
    "LARGE_VEHICLE": _LARGE,
    "BICYCLE": _CYCLIST,
    "BICYCLIST": _CYCLIST,
    "BUS": _LARGE,
    "TRAILER": _LARGE,
    "MOTORCYCLIST": _CYCLIST,
    "MOPED": _CYCLIST,
    "MOTORCYCLE": _CYCLIST,
    "STROLLER": _PERSON,
    "EMERGENCY_VEHICLE": _LARGE,
    "WHEELCHAIR": _PERSON,
    "SCHOOL_BUS": _LARGE,
}
_KITTI: Final = {
    "Car": _CAR,
    "Van": _CAR,
    "Truck": _LARGE,
    "Tram": _LARGE,
    "Pedestrian": _PERSON,
    "Person (sitting)": _PERSON,
    "Cyclist": _CYCLIST,
}
_WAYMO: Final = {1: _CAR, 2: _PERSON, 3: _OBSTACLE, 4: _CYCLIST}
# The first prefix that fits counts.
_NUSCENES: Final = (
    ("vehicle.bicycle", _CYCLIST),
    ("vehicle.motorcycle", _CYCLIST),
    ("vehicle.car", _CAR),
    ("vehicle.", _LARGE),
    ("human.", _PERSON),
    ("movable_object.", _OBSTACLE),
    ("static_object.", _OBSTACLE),
    ("animal", _ANIMAL),
)


def argoverse2_class(name: str) -> int:
    """Returns the surface of an Argoverse 2 category, 0 if it has none here."""
    return _ARGOVERSE2.get(name, UNKNOWN)


def argoverse2_classes(numbers: NDArray[np.integer[Any]]) -> NDArray[np.uint8]:
    """Returns the surface of each category number of Argoverse 2 flow labels.

    Args:
        numbers: (N,) 0 for background, 1 to 30 for the categories by alphabet.

    Raises:
        ValueError: If a number is none of these.
    """
    table = np.array([UNKNOWN, *_ARGOVERSE2.values()], dtype=np.uint8)
    wrong = numbers[(numbers < 0) | (numbers >= len(table))]
    if len(wrong):
        raise ValueError(f"category number {wrong[0]}, expected 0 to {len(table) - 1}")
    classes: NDArray[np.uint8] = table[numbers]
    return classes


def argoverse1_class(name: str) -> int:
    """Returns the surface of an Argoverse 1 category, 0 if it has none here."""
    return _ARGOVERSE1.get(name, UNKNOWN)


def kitti_class(name: str) -> int:
    """Returns the surface of a KITTI object type, 0 if it has none here."""
    return _KITTI.get(name, UNKNOWN)


def nuscenes_class(name: str) -> int:
    """Returns the surface of a nuScenes category, 0 if it has none here."""
    return next((kind for prefix, kind in _NUSCENES if name.startswith(prefix)), UNKNOWN)


def waymo_class(number: int) -> int:
    """Returns the surface of a Waymo label type, 0 if it has none here."""
    return _WAYMO.get(number, UNKNOWN)
