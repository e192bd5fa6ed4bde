"""Raw float32 rows without a header (.bin): KITTI's velodyne files, and those of nuScenes."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.sweep_in_file import SweepInFile, read_bytes, xyz_of_table

_NUSCENES_ENDING: Final = ".pcd.bin"
_KITTI_COLUMNS: Final = 4
_NUSCENES_COLUMNS: Final = 5


def read_bin(path: Path) -> SweepInFile:
    """Reads rows of x, y, z and intensity; with the ending .pcd.bin there is a ring, too.

    Raises:
        SweepFileError: If the file is missing, empty, or cut within a row.
    """
    is_nuscenes = path.name.endswith(_NUSCENES_ENDING)
    num_columns = _NUSCENES_COLUMNS if is_nuscenes else _KITTI_COLUMNS
    content = read_bytes(path)
    row_bytes = 4 * num_columns
    if len(content) % row_bytes:
        raise SweepFileError(
            f"{path}: has {len(content)} bytes, expected rows of {num_columns} float32, a multiple "
            f"of {row_bytes}"
        )
    table = np.frombuffer(content, dtype="<f4").reshape(-1, num_columns)
    return SweepInFile(xyz_of_table(path, "the table", table))
