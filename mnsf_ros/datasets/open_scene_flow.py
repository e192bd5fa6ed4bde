# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sequences in the format of OpenSceneFlow: HDF5 files with one group for each sweep."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mnsf_ros.datasets.argoverse2 import argoverse2_classes
from mnsf_ros.datasets.labelled_sweep import LabelledSweep, SweepSource
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import rigid_pose
from mnsf_ros.sweeps_io.files import as_type, reading

# Stamps below this are microseconds, others nanoseconds: either counted since 1970 or 1980.
_FIRST_NANOSECONDS: Final = 10**17
_STAMP: Final = re.compile("[0-9]{1,19}")


def open_file(source: Path) -> SweepSource:
    """Opens an `.h5` file."""
    keys = sweep_keys(source)
    return SweepSource("lidar", len(keys), _sweeps(source, keys))


def sweep_keys(source: Path) -> list[str]:
    """Returns the names of the groups of a file, in the order of their stamps.

    Raises:
        DatasetError: It cannot be read, or has other groups, or none.
    """
    with reading(source), h5_file(source) as file:
        keys = list(file.keys())
    wrong = [key for key in keys if not _STAMP.fullmatch(key)]
    if wrong or not keys:
        found = f"group {wrong[0]!r}" if wrong else "no group"
        raise DatasetError(f"{source}: has {found}, expected one named by the stamp of each sweep")
    return sorted(keys, key=int)


def nanoseconds(stamp: int) -> int:
    """Returns the stamp of a group in nanoseconds."""
    return stamp if stamp >= _FIRST_NANOSECONDS else stamp * 1000


def _sweeps(source: Path, keys: list[str]) -> Iterator[LabelledSweep]:
    with reading(source), h5_file(source) as file:
        for key in keys:
            with reading(source, f"group {key!r}"):
                sweep = _sweep(int(key), group_of(file, key))
            yield sweep


def h5_file(path: Path) -> Any:  # noqa: ANN401 - h5py.File
    """Opens an HDF5 file to read."""
    import h5py

    return h5py.File(path, "r")


def group_of(file: Any, key: str) -> Any:  # noqa: ANN401 - h5py.File, h5py.Group
    """Returns the group of a sweep.

    Raises:
        ValueError: It is in another file: by links HDF5 would read, and change, any.
    """
    group = file[key]
    if group.file.filename != file.filename:
        raise ValueError("is in another file")
    return group


def array_of(group: Any, name: str, dtype: DTypeLike) -> NDArray[Any]:  # noqa: ANN401
    """Returns the numbers of a data set of a sweep in the type asked for.

    Raises:
        ValueError: There is no such data set, or its values are in another file.
        FloatingPointError: The type cannot hold one of them.
    """
    if name not in group:
        raise ValueError(f"has no data set {name}; it has {', '.join(group)}")
    data = group[name]
    if data.file.filename != group.file.filename or data.is_virtual or data.external:
        raise ValueError(f"the values of {name!r} are in another file")
    return as_type(data[...], dtype)


def _sweep(stamp: int, group: Any) -> LabelledSweep:  # noqa: ANN401
    points = array_of(group, "lidar", np.float32)
    columns = {"intensity": np.ascontiguousarray(points[:, 3])} if points.shape[1] > 3 else {}
    if "lidar_dt" in group:
        columns["time_offset"] = array_of(group, "lidar_dt", np.float32)
    labels: dict[str, Any] = {}
    if "flow" in group:
        labels = {
            "flow": array_of(group, "flow", np.float32),
            "flow_valid": array_of(group, "flow_is_valid", bool),
            "class_id": argoverse2_classes(array_of(group, "flow_category_indices", np.int64)),
        }
    return LabelledSweep(
        stamp_ns=nanoseconds(stamp),
        xyz=np.ascontiguousarray(points[:, :3]),
        columns=columns,
        pose=rigid_pose(array_of(group, "pose", np.float64)) if "pose" in group else None,
        ground=array_of(group, "ground_mask", bool) if "ground_mask" in group else None,
        **labels,
    )
