# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Files of OpenSceneFlow, HDF5 with a group for each sweep: read, and given estimates."""

import pickle
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mnsf_ros.datasets.argoverse2 import argoverse2_classes, argoverse2_numbers
from mnsf_ros.datasets.exported_sweep import ExportedSweep
from mnsf_ros.datasets.labelled_sweep import LabelledSweep, SweepSource
from mnsf_ros.datasets.pose_frame import frame_of_points
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import rigid_pose
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S
from mnsf_ros.sweeps_io.files import as_type, new_file, reading

# Units of stamps in the files of the extractors: Argoverse 2; ZOD; nuScenes, Waymo, TruckScenes.
_UNITS_NS: Final = (1, 100, 1000)
# Stamps count from 1970, between 1979 (Argoverse 2 has 1980) and 2065; no two units fit both.
_SECONDS: Final = (3e8, 3e9)
# Between two sweeps of a lidar; of several units the one nearest to the usual interval counts.
_INTERVALS_S: Final = (0.005, 5.0)
# Pairs of sweeps that are compared with their poses.
_NUM_COMPARED: Final = 30
_STAMP: Final = re.compile("[0-9]{1,19}")
# Data sets of a sweep that are no estimate.
_SWEEP_KEYS: Final = ("lidar", "ground_mask", "pose")
_LABEL_KEYS: Final = (
    "flow",
    "flow_is_valid",
    "flow_category_indices",
    "flow_instance_id",
    "ego_motion",
    "dufo",
    "dufocluster",
)
# Coordinates in these files are float32.
_SAME_POINT_M: Final = 1e-2

_Arrays = dict[str, NDArray[Any]]


def open_file(source: Path) -> SweepSource:
    """Opens an `.h5` file."""
    keys = _sweep_keys(source)
    stamps = stamps_ns(keys)
    first = np.unique(np.linspace(0, len(keys) - 2, min(_NUM_COMPARED, len(keys) - 1)).astype(int))
    compared = (_sweeps(source, keys[one : one + 2], stamps) for one in first)
    from_points, note = frame_of_points((current, following) for current, following in compared)

    def sweeps() -> Iterator[LabelledSweep]:
        for sweep in _sweeps(source, keys, stamps):
            yield sweep if sweep.pose is None else replace(sweep, pose=sweep.pose @ from_points)

    return SweepSource("lidar", len(keys), sweeps(), note)


def _sweep_keys(source: Path) -> list[str]:
    """Returns the names of the groups of a file, in the order of their stamps."""
    with reading(source), _h5_file(source) as file:
        keys = list(file.keys())
    wrong = [key for key in keys if not _STAMP.fullmatch(key)]
    if wrong or not keys:
        found = f"group {wrong[0]!r}" if wrong else "no group"
        raise DatasetError(f"{source}: has {found}, expected one named by the stamp of each sweep")
    return sorted(keys, key=int)


def stamps_ns(keys: Iterable[str]) -> dict[str, int]:
    """Returns group to stamp in nanoseconds; the unit follows from digits and intervals."""
    stamps = {key: int(key) for key in keys}
    found = sorted(stamps.values()) or [0]
    interval = float(np.median(np.diff(np.array(found, float)))) if len(found) > 1 else 0.0

    def oddity(unit_ns: int) -> tuple[bool, bool, float]:
        is_date = _SECONDS[0] <= found[0] * unit_ns * 1e-9 < _SECONDS[1]
        interval_s = interval * unit_ns * 1e-9
        is_lidar = _INTERVALS_S[0] <= interval_s <= _INTERVALS_S[1]
        return not is_date, not is_lidar, abs(np.log(interval_s / USUAL_INTERVAL_S or 1.0))

    unit_ns = min(_UNITS_NS, key=oddity)
    return {key: stamp * unit_ns for key, stamp in stamps.items()}


def _sweeps(source: Path, keys: list[str], stamps: Mapping[str, int]) -> Iterator[LabelledSweep]:
    with reading(source), _h5_file(source) as file:
        for key in keys:
            with reading(source, f"group {key!r}"):
                sweep = _sweep(stamps[key], _group_of(file, key))
            yield sweep


def _h5_file(path: Path) -> Any:  # noqa: ANN401 - h5py.File
    """Opens an HDF5 file to read."""
    import h5py

    return h5py.File(path, "r")


def _group_of(file: Any, key: str) -> Any:  # noqa: ANN401 - h5py.File, h5py.Group
    group = file[key]
    # By links HDF5 would read, and change, any file.
    if group.file.filename != file.filename:
        raise ValueError("is in another file")
    return group


def _array_of(group: Any, name: str, dtype: DTypeLike) -> NDArray[Any]:  # noqa: ANN401
    """Returns the numbers of a data set of a sweep in the type asked for."""
    if name not in group:
        raise ValueError(f"has no data set {name}; it has {', '.join(group)}")
    data = group[name]
    if data.file.filename != group.file.filename or data.is_virtual or data.external:
        raise ValueError(f"the values of {name!r} are in another file")
    return as_type(data[...], dtype)


def _sweep(stamp_ns: int, group: Any) -> LabelledSweep:  # noqa: ANN401
    points = _array_of(group, "lidar", np.float32)
    columns = {"intensity": np.ascontiguousarray(points[:, 3])} if points.shape[1] > 3 else {}
    if "lidar_dt" in group:
        columns["time_offset"] = _array_of(group, "lidar_dt", np.float32)
    labels: dict[str, Any] = {}
    if "flow" in group:
        labels = {
            "flow": _array_of(group, "flow", np.float32),
            "flow_valid": _array_of(group, "flow_is_valid", bool),
            "class_id": argoverse2_classes(_array_of(group, "flow_category_indices", np.int64)),
        }
    return LabelledSweep(
        stamp_ns=stamp_ns,
        xyz=np.ascontiguousarray(points[:, :3]),
        columns=columns,
        pose=rigid_pose(_array_of(group, "pose", np.float64)) if "pose" in group else None,
        ground=_array_of(group, "ground_mask", bool) if "ground_mask" in group else None,
        **labels,
    )


class OpenSceneFlowWriter:
    """Adds sweeps to a file, see `open_scene_flow_writer`."""

    def __init__(self, path: Path, file: Any, key: str, *, labels: bool, overwrite: bool) -> None:  # noqa: ANN401
        self._path = path
        self._file = file
        self._key = key
        self._labels = labels
        self._overwrite = overwrite
        self._groups = {stamp: name for name, stamp in stamps_ns(file).items()}
        self._is_new = not self._groups
        # Numbers of objects in the file, which has 16 bits for them.
        self._instances = {0: 0}

    def write(self, sweep: ExportedSweep) -> None:
        """Adds a sweep, or its estimate to the sweep of the same stamp.

        Raises:
            DatasetError: The file has no such sweep, other points, or such an estimate already.
        """
        if self._is_new:
            group, arrays = self._file.create_group(str(sweep.sweep.stamp_ns)), _sweep_arrays(sweep)
        else:
            group, arrays = self._known_group(sweep), {}
        if sweep.next_from_current is not None:
            arrays[self._key] = sweep.in_rows(sweep.flow)
            truth = sweep.as_truth if self._labels else sweep.truth if self._is_new else None
            if truth is not None:
                arrays["ego_motion"] = sweep.next_from_current.astype(np.float32)
                arrays |= self._labels_of(sweep, truth)
        for name, values in arrays.items():
            if name in group:
                if not self._overwrite:
                    raise DatasetError(
                        f"{self._path}: group {group.name!r} has {name!r} already; --force "
                        "replaces it"
                    )
                del group[name]
            group.create_dataset(name, data=values)

    def _labels_of(self, sweep: ExportedSweep, truth: FlowTruth) -> _Arrays:
        objects = np.zeros(len(truth), int) if truth.object_id is None else truth.object_id
        known, places = np.unique(np.append(objects, 0), return_inverse=True)
        numbers = [self._instances.setdefault(one, len(self._instances)) for one in known.tolist()]
        columns = {
            "flow": np.where(truth.valid[:, None], truth.flow, np.float32(0.0)),
            "flow_is_valid": truth.valid,
            "flow_category_indices": argoverse2_numbers(truth.class_id),
            "flow_instance_id": np.array(numbers).astype(np.int16)[places[:-1]],
        }
        if self._labels:
            # Of SeFlow; clusters are numbered from 1 in each sweep.
            columns["dufo"] = truth.dynamic.astype(np.uint8)
            columns["dufocluster"] = places[:-1].astype(np.int16)
        return {name: sweep.in_rows(column) for name, column in columns.items()}

    def _known_group(self, sweep: ExportedSweep) -> Any:  # noqa: ANN401 - h5py.Group
        own, cloud = sweep.sweep, sweep.sweep.source
        name = self._groups.get(own.stamp_ns)
        if name is None:
            raise DatasetError(f"{self._path}: has no sweep of stamp {own.stamp_ns}")
        with reading(self._path, f"group {name!r}"):
            group = _group_of(self._file, name)
            points = _array_of(group, "lidar", np.float32)[:, :3]
        if len(points) != cloud.num_points or not np.allclose(
            points[cloud.rows], own.xyz, rtol=0.0, atol=_SAME_POINT_M
        ):
            raise DatasetError(f"{self._path}: group {name!r} has other points than the recording")
        return group


@contextmanager
def open_scene_flow_writer(
    path: Path, key: str, *, labels: bool = False, overwrite: bool = False
) -> Iterator[OpenSceneFlowWriter]:
    """Opens an `.h5` file for estimates of its sweeps; nothing is changed if the block fails.

    Without a file a new one is made, with the sweeps, their poses, and their truth if known, and
    the indexes of its folder that OpenSceneFlow reads.

    Args:
        path: The file.
        key: Name of the estimates, (N, 3) metres until the next sweep with ego motion.
        labels: Whether the estimates are also written as labels: `flow` and others for supervised
            methods, `dufo` and `dufocluster` for SeFlow. All dynamic points are then of the
            category REGULAR_VEHICLE.
        overwrite: Whether estimates of the same name are replaced.

    Raises:
        DatasetError: The key has another meaning, or the file cannot be read or written.
    """
    if key in (*_SWEEP_KEYS, *_LABEL_KEYS) or not key or "/" in key:
        raise DatasetError(f"key {key!r}: is no name of an estimate")
    import h5py

    is_new = not path.exists()
    if not is_new:
        _sweep_keys(path)
    with new_file(path, overwrite=True) as draft:
        if not is_new:
            shutil.copyfile(path, draft)
        with h5py.File(draft, "a") as file:
            yield OpenSceneFlowWriter(path, file, key, labels=labels, overwrite=overwrite)
    if is_new:
        _write_indexes(path.parent)


def _sweep_arrays(sweep: ExportedSweep) -> _Arrays:
    return {
        "lidar": sweep.in_rows(sweep.sweep.xyz),
        "ground_mask": sweep.in_rows(sweep.ground),
        "pose": sweep.pose.astype(np.float32),
    }


def _write_indexes(folder: Path) -> None:
    """Writes the lists of all sweeps of a folder, and of those with flow."""
    sweeps: list[list[str]] = []
    with_flow: list[list[str]] = []
    for path in sorted(folder.glob("*.h5")):
        keys = _sweep_keys(path)
        sweeps += [[path.stem, key] for key in keys]
        with reading(path), _h5_file(path) as file:
            with_flow += [[path.stem, key] for key in keys if "flow" in file[key]]
    for name, index in (("index_total.pkl", sweeps), ("index_flow.pkl", with_flow)):
        with new_file(folder / name, overwrite=True) as draft:
            draft.write_bytes(pickle.dumps(index))
