"""Feather tables (.feather), the sweeps of Argoverse 2."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.sweep_in_file import SweepInFile, read_bytes, reading, xyz_of_columns

_NO_PYARROW: Final = (
    "feather files are read with pyarrow, which is not installed; install it with: "
    "python -m pip install pyarrow"
)
# Nanoseconds since 1970 have 19 digits until the year 2286; the first data sets have 18.
_STAMP_DIGITS: Final = (18, 19)


def read_feather(path: Path) -> SweepInFile:
    """Reads the columns x, y and z; a name that is a number of nanoseconds is the stamp.

    Raises:
        SweepFileError: If the file is missing or damaged, lacks a column, or pyarrow is missing.
    """
    read_bytes(path)
    try:
        from pyarrow import feather
    except ModuleNotFoundError as error:
        if error.name != "pyarrow":
            raise
        raise SweepFileError(f"{path}: {_NO_PYARROW}") from error
    with reading(path):
        # Without memory_map, since a damaged file could only be noticed later.
        table = feather.read_table(path, memory_map=False)
        missing = [name for name in "xyz" if name not in table.column_names]
        if missing:
            raise SweepFileError(
                f"{path}: has no column {', '.join(missing)}; it has "
                f"{', '.join(table.column_names)}"
            )
        columns: list[NDArray[Any]] = [np.asarray(table.column(name)) for name in "xyz"]
        return SweepInFile(xyz_of_columns(path, columns), _stamp_in(path))


def _stamp_in(path: Path) -> int:
    is_stamp = path.stem.isdecimal() and len(path.stem) in _STAMP_DIGITS
    return int(path.stem) if is_stamp else 0
