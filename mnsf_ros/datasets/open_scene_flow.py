"""Sequences that OpenSceneFlow prepared: HDF5 files with one group for each sweep."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mnsf_ros.datasets.errors import DatasetError
from mnsf_ros.datasets.labelled_sweep import GivenFlow, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import reading, require
from mnsf_ros.datasets.surface_classes import argoverse2_classes

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mnsf_ros.datasets.read_options import ReadOptions

# Stamps below this are microseconds, others nanoseconds: either counted since 1970 or 1980.
_FIRST_NANOSECONDS: Final = 10**17


def open_sequence(source: Path, _: ReadOptions) -> SweepSource:
    """Opens a sequence.

    Args:
        source: An `.h5` file.

    Raises:
        DatasetError: If it is missing, damaged or laid out in another way.
    """
    h5py = require("h5py")
    with reading(source):
        if not source.is_file():
            raise FileNotFoundError(source)
        with h5py.File(source, "r") as file:
            keys = list(file.keys())
    wrong = [key for key in keys if not key.isdigit()]
    if wrong or not keys:
        found = f"group {wrong[0]!r}" if wrong else "no group"
        raise DatasetError(f"{source}: has {found}, expected one named by the stamp of each sweep")
    return SweepSource("lidar", len(keys), _sweeps(source, sorted(keys, key=int), h5py))


def _sweeps(source: Path, keys: list[str], h5py: Any) -> Iterator[LabelledSweep]:  # noqa: ANN401
    with reading(source), h5py.File(source, "r") as file:
        for key in keys:
            yield _sweep(int(key), file[key])


def _sweep(stamp: int, group: Any) -> LabelledSweep:  # noqa: ANN401
    points = np.asarray(group["lidar"], dtype=np.float32)
    ground = np.asarray(group["ground_mask"], dtype=bool) if "ground_mask" in group else None
    columns = {"intensity": np.ascontiguousarray(points[:, 3])} if points.shape[1] > 3 else {}
    if "lidar_dt" in group:
        columns["time_offset"] = np.asarray(group["lidar_dt"], dtype=np.float32)
    return LabelledSweep(
        stamp_ns=stamp if stamp >= _FIRST_NANOSECONDS else stamp * 1000,
        xyz=np.ascontiguousarray(points[:, :3]),
        columns=columns,
        pose=np.asarray(group["pose"], dtype=np.float64),
        given=_given(group) if "flow" in group else None,
        ground=ground,
    )


def _given(group: Any) -> GivenFlow:  # noqa: ANN401
    categories = np.asarray(group["flow_category_indices"]).astype(np.int64)
    return GivenFlow(
        flow=np.asarray(group["flow"], dtype=np.float32),
        valid=np.asarray(group["flow_is_valid"], dtype=bool),
        class_id=argoverse2_classes(categories),
        # The poses do not tell what moves: some are those of the vehicle, while the points are
        # in the frame of the lidar.
        background=categories == 0,
    )
