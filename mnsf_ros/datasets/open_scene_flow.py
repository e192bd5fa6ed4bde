# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sequences that OpenSceneFlow prepared: HDF5 files with one group for each sweep."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mnsf_ros.datasets.hdf5 import array, group
from mnsf_ros.datasets.labelled_sweep import GivenFlow, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import reading
from mnsf_ros.datasets.surface_classes import argoverse2_classes
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion
from mnsf_ros.geometry.transforms import FloatArray, invert, rigid_pose
from mnsf_ros.sweeps_io.files import require

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

# A lidar 1 m before the axis about which a vehicle turns goes so far astray at 1° per second.
_SAME_PLACE_M: Final = 2e-3
_SAME_TURN: Final = 1e-3


class LidarTrack:
    """Poses of the frame of the points, chained from sweep to sweep.

    The flow of what stands still tells how that frame moved. The poses of the files may be those
    of the vehicle instead, which moves in another way wherever it turns; they are followed only
    across sweeps without flow, and only if they agreed with all flow before.
    """

    def __init__(self) -> None:
        """Starts at the first sweep, whose frame is the world's."""
        self._pose: FloatArray | None = np.eye(4)
        self._last: tuple[FloatArray, FloatArray | None] | None = None
        self._agreed: list[bool] = []

    def advance(
        self, world_from_vehicle: FloatArray, by_flow: FloatArray | None
    ) -> FloatArray | None:
        """Returns `world_from_sweep` of the next sweep, None from where on it is not known.

        The file has the pose `world_from_vehicle`. `by_flow` is the motion from this sweep to the
        one after it, as the flow of what stands still has it; None if there is no such flow.
        """
        if self._last is not None and self._pose is not None:
            last_pose, motion = self._last
            by_poses = invert(world_from_vehicle) @ last_pose
            if motion is not None:
                self._agreed.append(_is_same(by_poses, motion))
            elif self._agreed and all(self._agreed):
                motion = by_poses
            self._pose = None if motion is None else self._pose @ invert(motion)
        self._last = (world_from_vehicle, by_flow)
        return self._pose


def _is_same(one: FloatArray, other: FloatArray) -> bool:
    apart = np.abs(one - other)
    return bool(apart[:3, :3].max() < _SAME_TURN and apart[:3, 3].max() < _SAME_PLACE_M)


# Stamps below this are microseconds, others nanoseconds: either counted since 1970 or 1980.
_FIRST_NANOSECONDS: Final = 10**17
_STAMP: Final = re.compile("[0-9]{1,19}")
# What comes with flow.
_FLOW: Final = ("flow_is_valid", "flow_category_indices")
# Fewer points may all be on one thing, which tells little about a turn.
_MIN_BACKGROUND: Final = 100


def open_file(source: Path) -> SweepSource:
    """Opens an `.h5` file."""
    with reading(source):
        h5py = require("h5py")
        if not source.is_file():
            raise FileNotFoundError(source)
        with h5py.File(source, "r") as file:
            keys = list(file.keys())
    wrong = [key for key in keys if not _STAMP.fullmatch(key)]
    if wrong or not keys:
        found = f"group {wrong[0]!r}" if wrong else "no group"
        raise DatasetError(f"{source}: has {found}, expected one named by the stamp of each sweep")
    return SweepSource("lidar", len(keys), _sweeps(source, sorted(keys, key=int), h5py))


def _sweeps(source: Path, keys: list[str], h5py: Any) -> Iterator[LabelledSweep]:  # noqa: ANN401
    track = LidarTrack()
    with reading(source), h5py.File(source, "r") as file:
        for key in keys:
            with reading(source, f"group {key!r}"):
                held = group(file, key)
                sweep = _sweep(int(key), held)
                world_from_vehicle = rigid_pose(array(held, "pose", np.float64))
            motion = None if sweep.given is None else sweep.given.next_from_current
            yield replace(sweep, pose=track.advance(world_from_vehicle, motion))


def _sweep(stamp: int, held: Any) -> LabelledSweep:  # noqa: ANN401
    # To ask whether a name is in a group would follow links.
    names = list(held)
    flow_names = _FLOW if "flow" in names else ()
    missing = [name for name in ("lidar", "pose", *flow_names) if name not in names]
    if missing:
        raise ValueError(f"has no data set {', '.join(missing)}; it has {', '.join(names)}")
    points = array(held, "lidar", np.float32)
    columns = {"intensity": np.ascontiguousarray(points[:, 3])} if points.shape[1] > 3 else {}
    if "lidar_dt" in names:
        columns["time_offset"] = array(held, "lidar_dt", np.float32)
    sweep = LabelledSweep(
        stamp_ns=stamp if stamp >= _FIRST_NANOSECONDS else stamp * 1000,
        xyz=np.ascontiguousarray(points[:, :3]),
        columns=columns,
        given=_given(held) if "flow" in names else None,
        ground=array(held, "ground_mask", bool) if "ground_mask" in names else None,
    )
    if sweep.given is None:
        return sweep
    # What has no category stands still.
    still = sweep.given.valid & (array(held, "flow_category_indices", np.int64) == 0)
    if np.count_nonzero(still) < _MIN_BACKGROUND:
        return sweep
    motion = fit_rigid_motion(sweep.xyz[still], sweep.given.flow[still])
    return replace(sweep, given=replace(sweep.given, next_from_current=motion))


def _given(held: Any) -> GivenFlow:  # noqa: ANN401
    return GivenFlow(
        flow=array(held, "flow", np.float32),
        valid=array(held, "flow_is_valid", bool),
        class_id=argoverse2_classes(array(held, "flow_category_indices", np.int64)),
    )
