# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sequences in the format of OpenSceneFlow: HDF5 files with one group for each sweep."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mnsf_ros.datasets.labelled_sweep import GivenFlow, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import as_type, reading
from mnsf_ros.datasets.surface_classes import argoverse2_classes
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion
from mnsf_ros.geometry.transforms import FloatArray, invert
from mnsf_ros.sweeps_io.files import require

# Stamps below this are microseconds, others nanoseconds: either counted since 1970 or 1980.
_FIRST_NANOSECONDS: Final = 10**17
_STAMP: Final = re.compile("[0-9]{1,19}")
# Fewer background points may all be on one object, which tells little about a turn.
_MIN_BACKGROUND: Final = 100


def open_file(source: Path) -> SweepSource:
    """Opens an `.h5` file."""
    keys = sweep_keys(source)
    return SweepSource("lidar", len(keys), _sweeps(source, keys))


def sweep_keys(source: Path) -> list[str]:
    """Returns the names of the groups of a file, in the order of their stamps.

    Raises:
        DatasetError: It cannot be read, or has other groups, or none.
    """
    with reading(source), require("h5py").File(source, "r") as file:
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
    """Yields the sweeps, with poses chained by the flow of static points.

    Poses of the files may be those of the vehicle instead of the points' frame. From the first
    sweep without flow on the pose is unknown.
    """
    pose: FloatArray | None = np.eye(4)  # the frame of the first sweep is the world's
    with reading(source), require("h5py").File(source, "r") as file:
        for key in keys:
            with reading(source, f"group {key!r}"):
                sweep = _sweep(int(key), SweepGroup(file, key))
            yield replace(sweep, pose=pose)
            motion = None if sweep.given is None else sweep.given.next_from_current
            pose = None if pose is None or motion is None else pose @ invert(motion)


class SweepGroup:
    """The data sets of one sweep, all in the file itself.

    HDF5 can lead to any other file: by links, virtual data sets and external storage.

    Attributes:
        group: The h5py.Group.
    """

    def __init__(self, file: Any, key: str) -> None:  # noqa: ANN401 - h5py.File
        _check_place(file, key)
        self.group: Final = file[key]
        self._names = list(self.group)

    def __contains__(self, name: str) -> bool:
        return name in self._names

    def array(self, name: str, dtype: DTypeLike) -> NDArray[Any]:
        """Returns the numbers of a data set in the type asked for.

        Raises:
            ValueError: There is no such data set, or its values are not in the file.
            FloatingPointError: The type cannot hold one of them.
        """
        if name not in self._names:
            raise ValueError(f"has no data set {name}; it has {', '.join(self._names)}")
        _check_place(self.group, name)
        data = self.group[name]
        if data.is_virtual or data.external:
            raise ValueError(f"the values of {name!r} are in another file")
        return as_type(data[...], dtype)


def _check_place(parent: Any, name: str) -> None:  # noqa: ANN401
    # `get(name, getlink=True)` of h5py would follow the link before it says what it is.
    if parent.id.links.get_info(name.encode()).type != require("h5py").h5l.TYPE_HARD:
        raise ValueError(f"{name!r} is a link, expected it in the file itself")


def _sweep(stamp: int, group: SweepGroup) -> LabelledSweep:
    points = group.array("lidar", np.float32)
    columns = {"intensity": np.ascontiguousarray(points[:, 3])} if points.shape[1] > 3 else {}
    if "lidar_dt" in group:
        columns["time_offset"] = group.array("lidar_dt", np.float32)
    sweep = LabelledSweep(
        stamp_ns=nanoseconds(stamp),
        xyz=np.ascontiguousarray(points[:, :3]),
        columns=columns,
        ground=group.array("ground_mask", bool) if "ground_mask" in group else None,
    )
    return _with_flow(sweep, group) if "flow" in group else sweep


def _with_flow(sweep: LabelledSweep, group: SweepGroup) -> LabelledSweep:
    categories = group.array("flow_category_indices", np.int64)
    given = GivenFlow(
        flow=group.array("flow", np.float32),
        valid=group.array("flow_is_valid", bool),
        class_id=argoverse2_classes(categories),
    )
    sweep = replace(sweep, given=given)
    # Points without a category are static.
    static = given.valid & (categories == 0)
    if np.count_nonzero(static) < _MIN_BACKGROUND:
        return sweep
    motion = fit_rigid_motion(sweep.xyz[static], given.flow[static])
    return replace(sweep, given=replace(given, next_from_current=motion))
