# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The two metrics of the Argoverse 2 scene flow challenge.

* Three-way EPE (2023): the mean of the EPE of foreground dynamic, foreground static and background
  static points, as in the package av2: foreground is all that is labelled as an object.
* Bucket-normalized error (2024): per class, points are sorted into buckets of 0.04 m by their true
  motion of their own in 0.1 s. Of the first bucket the EPE counts (static error), of each other
  one its EPE over its mean motion; the mean over these is the dynamic error. 1 is the error of
  the sensor's own motion alone. Only points less than 35 m away along x and along y count, and not
  those of signs, cones and animals, as in the package bucketed_scene_flow_eval.

Both are means over all points of all examples, so an example gives sums, which can be added.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.evaluation.metrics import mean
from mnsf_ros.recording.flow_truth import SurfaceClass

# Of a group of points: their number, the sum of their errors (m), the sum of their own motion (m).
Sums = dict[str, list[float]]

FOREGROUND_DYNAMIC: Final = "foreground dynamic"
FOREGROUND_STATIC: Final = "foreground static"
BACKGROUND_STATIC: Final = "background static"
THREE_WAY: Final = (FOREGROUND_DYNAMIC, FOREGROUND_STATIC, BACKGROUND_STATIC)
DYNAMIC: Final = "dynamic"
STATIC: Final = "static"

_REACH_M: Final = 35.0
_EDGES_M: Final = np.append(np.linspace(0.0, 2.0, 51), np.inf)
_BACKGROUND: Final = "BACKGROUND"
_IGNORED: Final = ""
_OBJECTS: Final = {
    SurfaceClass.CAR: "CAR",
    SurfaceClass.LARGE_VEHICLE: "OTHER_VEHICLES",
    SurfaceClass.PEDESTRIAN: "PEDESTRIAN",
    SurfaceClass.CYCLIST: "WHEELED_VRU",
    SurfaceClass.OBSTACLE: _IGNORED,
    SurfaceClass.ANIMAL: _IGNORED,
}


def three_way_sums(
    errors_m: NDArray[np.float64], dynamic: NDArray[np.bool_], class_id: NDArray[np.uint8]
) -> Sums:
    """Adds up end point errors (N,) in metres over the three groups of the three-way EPE.

    `dynamic` and `class_id` are (N,), see `docs/recordings.md`. Groups without points are missing.
    """
    foreground = np.isin(class_id, list(_OBJECTS))
    groups = {
        FOREGROUND_DYNAMIC: foreground & dynamic,
        FOREGROUND_STATIC: foreground & ~dynamic,
        BACKGROUND_STATIC: ~foreground & ~dynamic,
    }
    motion = np.zeros_like(errors_m)
    return {
        name: _sums(errors_m[mask], motion[mask]) for name, mask in groups.items() if mask.any()
    }


def bucket_sums(
    errors_m: NDArray[np.float64],
    motion_m: NDArray[np.float64],
    xy: NDArray[np.floating[Any]],
    class_id: NDArray[np.uint8],
) -> Sums:
    """Adds up errors and motion of each class and bucket.

    `errors_m` and `motion_m`, the true motion without that of the sensor, are (N,) metres in 0.1 s,
    `xy` is (N, 2) metres in the sensor's frame, `class_id` (N,) as in `docs/recordings.md`.

    Returns:
        `CLASS/bucket` to its sums; the first bucket is 0. Empty ones are missing.
    """
    near = (np.abs(xy) < _REACH_M).all(axis=1)
    errors_m, motion_m, class_id = errors_m[near], motion_m[near], class_id[near]
    buckets = np.searchsorted(_EDGES_M, motion_m, side="right") - 1
    masks = {name: class_id == number for number, name in _OBJECTS.items() if name}
    masks[_BACKGROUND] = ~np.isin(class_id, list(_OBJECTS))
    sums: Sums = {}
    for name, mask in masks.items():
        for bucket in np.unique(buckets[mask]):
            rows = mask & (buckets == bucket)
            sums[f"{name}/{bucket}"] = _sums(errors_m[rows], motion_m[rows])
    return sums


def added(parts: Iterable[Mapping[str, list[float]]]) -> Sums:
    """Adds the sums of several examples."""
    columns: dict[str, list[list[float]]] = {}
    for part in parts:
        for name, sums in part.items():
            columns.setdefault(name, []).append(sums)
    return {
        name: [math.fsum(column) for column in zip(*rows, strict=True)]
        for name, rows in columns.items()
    }


def over_all_points(
    parts: Iterable[Mapping[str, list[float]]],
) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Returns both metrics over the points of several examples, with a `mean`; empty without any.

    The first mean is that of the three groups, NaN without one of them, the second that of the
    classes which have a value.
    """
    sums = added(parts)
    if not sums:
        return {}, {}
    groups, classes = three_way_epe_m(sums), bucketed_errors(sums)
    groups["mean"] = math.fsum(groups.values()) / len(groups)
    if classes:
        means = {kind: mean([own[kind] for own in classes.values()]) for kind in (DYNAMIC, STATIC)}
        classes["mean"] = means
    return groups, classes


def three_way_epe_m(sums: Mapping[str, list[float]]) -> dict[str, float]:
    """Returns the EPE of each of the three groups, NaN without points, metres."""
    return {name: _mean_error(sums.get(name)) for name in THREE_WAY}


def bucketed_errors(sums: Mapping[str, list[float]]) -> dict[str, dict[str, float]]:
    """Returns class to its dynamic error (normalized) and its static error (m), NaN if unknown."""
    ratios: dict[str, list[float]] = {}
    static_m: dict[str, float] = {}
    for name, (_, error_sum_m, motion_sum_m) in sums.items():
        class_name, _, bucket = name.partition("/")
        if not bucket:
            continue
        ratios.setdefault(class_name, [])
        if bucket == "0":
            static_m[class_name] = _mean_error(sums[name])
        else:
            ratios[class_name].append(error_sum_m / motion_sum_m)
    return {
        class_name: {
            DYNAMIC: math.fsum(ratios[class_name]) / len(ratios[class_name])
            if ratios[class_name]
            else math.nan,
            STATIC: static_m.get(class_name, math.nan),
        }
        for class_name in sorted(ratios)
    }


def _sums(errors_m: NDArray[np.float64], motion_m: NDArray[np.float64]) -> list[float]:
    return [float(len(errors_m)), math.fsum(errors_m), math.fsum(motion_m)]


def _mean_error(sums: list[float] | None) -> float:
    return sums[1] / sums[0] if sums else math.nan
