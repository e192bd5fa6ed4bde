# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps in npz files: the project's layout, and the layout of NSFP, FNSF and MNSF."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Bools
from mnsf_ros.datasets.kitti import KITTI
from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import planar_pose, rigid_pose
from mnsf_ros.sweeps.sweep import NANOSECONDS
from mnsf_ros.sweeps_io.files import as_type, columns_of, files_in, read_json, read_npz, reading

_EXTRA: Final = {
    "intensity": ("intensity", np.float32),
    "ring": ("ring", np.uint16),
    "time_offset": ("time_offset", np.float32),
}
# Files of triplets have no stamps; these are made up.
_FIRST_NS: Final = 1_700_000_000_000_000_000
_INTERVAL_NS: Final = 100_000_000
# A gap, so that the sweeps of two files are not consecutive.
_BETWEEN_FILES_NS: Final = 10_000_000_000


def open_sweeps(source: Path) -> SweepSource:
    """Opens a folder of npz files, named in the order of time, with an optional `boxes.json`."""
    files = files_in(source, "*.npz")
    box_file = source / "boxes.json"
    boxes = _read_boxes(box_file) if box_file.is_file() else {}
    with reading(files[0]):
        first_ns = int(read_npz(files[0], ("stamp_ns",))["stamp_ns"])
    # A message has no stamp before 0, and 0 is none.
    shift_s = max(0, -((first_ns - 1) // NANOSECONDS))
    note = f"stamps begin at {first_ns} ns: all are made {shift_s} s later" if shift_s else ""
    sweeps = (
        _sweep(file, boxes.get(number), shift_s * NANOSECONDS) for number, file in enumerate(files)
    )
    return SweepSource("lidar", len(files), sweeps, note)


def _sweep(file: Path, boxes: tuple[Box, ...] | None, shift_ns: int) -> LabelledSweep:
    arrays = read_npz(file, ("xyz", "stamp_ns"))
    with reading(file):
        return LabelledSweep(
            stamp_ns=int(arrays["stamp_ns"]) + shift_ns,
            xyz=as_type(arrays["xyz"], np.float32),
            columns=columns_of(arrays, _EXTRA),
            pose=rigid_pose(arrays["pose"]) if "pose" in arrays else None,
            boxes=boxes,
            flow=as_type(arrays["flow"], np.float32) if "flow" in arrays else None,
            flow_valid=_flags(arrays, "flow_valid"),
            dynamic=_flags(arrays, "is_dynamic") if "flow" in arrays else None,
            labelled=_flags(arrays, "label_valid"),
            ground=_flags(arrays, "is_ground"),
        )


def _flags(arrays: Mapping[str, NDArray[Any]], name: str) -> Bools | None:
    return as_type(arrays[name], bool) if name in arrays else None


def _read_boxes(path: Path) -> dict[int, tuple[Box, ...]]:
    """Returns boxes by the number of their sweep, counted from 0."""
    boxes: dict[int, tuple[Box, ...]] = {}
    for number, rows in read_json(path, dict).items():
        with reading(path, f"sweep {number}"):
            boxes[int(number)] = tuple(_box(row) for row in rows)
    return boxes


def _box(row: Mapping[str, Any]) -> Box:
    x, y, z = row["center"]
    return Box(
        pose=planar_pose(x, y, row["yaw"], z),
        size_m=np.asarray(row["size"], dtype=np.float64),
        class_id=KITTI.get(row["cls"], 0),
        track_id=row["track_id"],
    )


def open_triplets(source: Path) -> SweepSource:
    """Opens an npz file, or all files of a folder and its subfolders one after the other.

    Each has pc1, pc2, pc3 and flow23 (flow12), or pc1, pc2 and flow.
    """
    if not source.exists():
        raise DatasetError(f"{source}: no such file or folder")
    files = files_in(source, "**/*.npz") if source.is_dir() else [source]
    is_triplet = "pc3" in read_npz(files[0], ("pc1", "pc2"))
    return SweepSource("lidar", (3 if is_triplet else 2) * len(files), _sweeps_of_files(files))


def _sweeps_of_files(files: list[Path]) -> Iterator[LabelledSweep]:
    for number, file in enumerate(files):
        first_ns = _FIRST_NS + number * _BETWEEN_FILES_NS
        arrays = read_npz(file, ("pc1", "pc2"))
        flow_names = ("flow12", "flow23") if "pc3" in arrays else ("flow",)
        if not any(name in arrays for name in flow_names):
            raise DatasetError(
                f"{file}: has no flow ({' or '.join(flow_names)}); it has "
                f"{', '.join(sorted(arrays))}"
            )
        for index, flow_name in enumerate((*flow_names, "")):
            xyz, flow = arrays[f"pc{index + 1}"], arrays.get(flow_name)
            # The other labels are of the sweep in the middle.
            labels = arrays if flow is not None and flow_name == flow_names[-1] else {}
            with reading(file):
                yield LabelledSweep(
                    stamp_ns=first_ns + index * _INTERVAL_NS,
                    xyz=as_type(xyz, np.float32),
                    flow=None if flow is None else as_type(flow, np.float32),
                    dynamic=_flags(labels, "is_dynamic"),
                    labelled=_flags(labels, "label_valid"),
                    # The ground is removed already; the lowest points of the rest are not ground.
                    ground=np.zeros(len(xyz), dtype=bool),
                )
