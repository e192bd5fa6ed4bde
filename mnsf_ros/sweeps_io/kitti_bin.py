"""Raw float32 rows without a header (.bin): KITTI's velodyne files, and those of nuScenes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.sweep_in_file import SweepInFile, read_bytes, xyz_of_table

_NUSCENES_ENDING: Final = ".pcd.bin"
_KITTI_COLUMNS: Final = 4
_NUSCENES_COLUMNS: Final = 5
_BYTES: Final = 4
_MAX_RING: Final = 127


def read_bin(path: Path) -> SweepInFile:
    """Reads rows of x, y, z and intensity; with the ending .pcd.bin there is a ring, too.

    Raises:
        SweepFileError: If the file is missing, empty, cut within a row, or of the other kind.
    """
    is_nuscenes = path.name.lower().endswith(_NUSCENES_ENDING)
    num_columns = _NUSCENES_COLUMNS if is_nuscenes else _KITTI_COLUMNS
    content = read_bytes(path)
    if not is_nuscenes and _has_rings(content):
        raise SweepFileError(
            f"{path}: its rows are x, y, z, intensity and ring, as those of nuScenes: let its name "
            f"end with {_NUSCENES_ENDING}"
        )
    row_bytes = _BYTES * num_columns
    if len(content) % row_bytes:
        raise SweepFileError(
            f"{path}: has {len(content)} bytes, expected rows of {num_columns} float32, a multiple "
            f"of {row_bytes}"
        )
    return SweepInFile(xyz_of_table(path, "the table", _table(content, num_columns)))


def _has_rings(content: bytes) -> bool:
    """Whether each fifth number is the number of a ring, as no coordinate ever is."""
    if len(content) % (_BYTES * _NUSCENES_COLUMNS):
        return False
    table = _table(content, _NUSCENES_COLUMNS)
    rings, others = table[:, -1], table[:, :3]
    are_rings = np.isin(rings, np.arange(_MAX_RING + 1)).all()
    return bool(are_rings and (others != np.round(others)).any())


def _table(content: bytes, num_columns: int) -> NDArray[Any]:
    return np.frombuffer(content, dtype="<f4").reshape(-1, num_columns)
