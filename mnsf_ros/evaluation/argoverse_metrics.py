# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The metrics of the Argoverse 2 scene flow challenges.

* Three-way EPE (2023): the mean of the EPE of foreground dynamic, foreground static and background
  static points, as in the package av2: foreground is everything labelled as an object.
* Bucket-normalized error (2024): the points of each class fall into buckets of 0.04 m by their true
  motion in 0.1 s without ego motion. The first bucket gives the static error, its EPE. Each other
  one gives its EPE over its mean motion; the mean over these is the dynamic error, 1 for ego
  motion alone. Only points less than 35 m away along x and along y count, without signs, cones and
  animals, as in the package bucketed_scene_flow_eval.
* Range-wise EPE, as in OpenSceneFlow 848bf86: static points, and dynamic ones from 1.4 m/s on, by
  their distance from the sensor.

All are means over all points of all examples, so an example gives sums, which are added.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import AnyFloats, Bools, Floats
from mnsf_ros.recording.flow_truth import SurfaceClass

# Group of points to their number, sum of errors (m) and sum of motion without ego motion (m).
Sums = dict[str, list[float]]

THREE_WAY: Final = ("foreground dynamic", "foreground static", "background static")

_RANGES: Final = {"0-35": 35.0, "35-50": 50.0, "50-75": 75.0, "75-100": 100.0, "100-inf": math.inf}
_KINDS: Final = ("static", "dynamic")
RANGE_WISE: Final = tuple(f"{kind} {name}" for kind in _KINDS for name in (*_RANGES, "mean"))
# A pedestrian walks 1.4 m/s.
_MOVING_M: Final = 0.14

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


def three_way_sums(errors_m: Floats, dynamic: Bools, class_id: NDArray[np.uint8]) -> Sums:
    """Adds up end point errors (N,) in metres over the three groups of the three-way EPE.

    Groups without points are missing.
    """
    foreground = np.isin(class_id, list(_OBJECTS))
    masks = (foreground & dynamic, foreground & ~dynamic, ~foreground & ~dynamic)
    groups, motion = zip(THREE_WAY, masks, strict=True), np.zeros_like(errors_m)
    return {name: _sums(errors_m[mask], motion[mask]) for name, mask in groups if mask.any()}


def bucket_sums(
    errors_m: Floats, motion_m: Floats, xy: AnyFloats, class_id: NDArray[np.uint8]
) -> Sums:
    """Adds up errors and motion of each class and bucket, as `CLASS/bucket`, the first one is 0.

    `errors_m` and `motion_m`, the true motion without ego motion, are (N,) metres in 0.1 s, `xy` is
    (N, 2) metres in the sensor frame. Empty buckets are missing.
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


def range_sums(errors_m: Floats, motion_m: Floats, range_m: Floats) -> Sums:
    """Adds up errors of static and dynamic points by range (N,), otherwise as `bucket_sums`."""
    places = np.searchsorted(list(_RANGES.values()), range_m, side="right")
    groups = 2 * places + (motion_m >= _MOVING_M)
    names = [f"{kind} {name}" for name in _RANGES for kind in _KINDS]
    return {
        names[group]: _sums(errors_m[groups == group], motion_m[groups == group])
        for group in np.unique(groups).tolist()
    }


def over_all_points(parts: Iterable[Mapping[str, list[float]]]) -> dict[str, float]:
    """Returns all metrics over the points of several examples; empty without any.

    Returns:
        `three_way.GROUP` to EPE in metres, and `three_way.mean`, NaN without points of all groups;
        `bucketed.CLASS.dynamic` (normalized) and `bucketed.CLASS.static` (m), and those of the
        class `mean`, the mean over the classes that have a value;
        `range_wise.NAME` (m) for those of `RANGE_WISE` that have one.
    """
    # Here, because tasks score examples without tables.
    import pandas as pd

    table = pd.DataFrame(
        [(name, *sums) for part in parts for name, sums in part.items()],
        columns=["name", "number", "error_m", "motion_m"],
    )
    if table.empty:
        return {}
    sums = table.groupby("name").sum()
    epe_m, ratios = sums["error_m"] / sums["number"], sums["error_m"] / sums["motion_m"]
    groups = epe_m.reindex(THREE_WAY)
    found: dict[str, float] = groups.add_prefix("three_way.").to_dict()
    found["three_way.mean"] = groups.mean(skipna=False)
    for kind in _KINDS:
        ranges = epe_m.reindex([f"{kind} {name}" for name in _RANGES]).dropna()
        if len(ranges):
            ranges[f"{kind} mean"] = ranges.mean()
        found |= ranges.add_prefix("range_wise.").to_dict()
    buckets = [name for name in sums.index if "/" in name]
    classes = pd.DataFrame(
        {
            "dynamic": ratios[[name for name in buckets if not name.endswith("/0")]],
            "static": epe_m[[name for name in buckets if name.endswith("/0")]],
        },
        index=buckets,
    )
    classes = classes.groupby(lambda name: name.partition("/")[0]).mean()
    if buckets:
        classes.loc["mean"] = classes.mean()
    return found | {
        f"bucketed.{name}.{kind}": value for (name, kind), value in classes.stack().items()
    }


def _sums(errors_m: Floats, motion_m: Floats) -> list[float]:
    return [float(len(errors_m)), math.fsum(errors_m), math.fsum(motion_m)]
