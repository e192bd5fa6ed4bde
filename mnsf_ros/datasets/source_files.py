"""Files of data sets: found, read and checked, with one line of text for all that goes wrong."""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from mnsf_ros.errors import DatasetError
from mnsf_ros.sweeps_io.arrays import open_archive
from mnsf_ros.sweeps_io.sweep_in_file import UNREADABLE, reason


@contextmanager
def reading(path: Path, part: str = "") -> Iterator[None]:
    """Turns what parsers raise inside the block into a DatasetError that names the file.

    Args:
        path: The file.
        part: What is read of it, if that tells more.
    """
    try:
        yield
    except FileNotFoundError as error:
        raise DatasetError(f"{path}: no such file") from error
    except UNREADABLE as error:
        what = f"{part}: {reason(error)}" if part else reason(error)
        raise DatasetError(f"{path}: cannot be read: {what}") from error


def require(module: str) -> Any:  # noqa: ANN401
    """Imports a module of a library that only data sets need.

    Raises:
        DatasetError: If the library is not installed; the text has the command that helps.
    """
    library = module.partition(".")[0]
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != library:
            raise
        raise DatasetError(
            f"this format is read with {library}, which is not installed; "
            f"install it with: python -m pip install {library}"
        ) from error


def files_in(folder: Path, pattern: str) -> list[Path]:
    """Returns the files of a folder that fit a pattern, by name.

    Raises:
        DatasetError: If there is no such folder, or no such file in it.
    """
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder")
    files = sorted(file for file in folder.glob(pattern) if file.is_file())
    if not files:
        raise DatasetError(f"{folder}: holds no file {pattern!r}")
    return files


def read_json(path: Path) -> Any:  # noqa: ANN401
    """Returns the content of a JSON file.

    Raises:
        DatasetError: If it is missing or damaged.
    """
    with reading(path):
        return json.loads(path.read_bytes())


def read_float_rows(path: Path, num_columns: int) -> NDArray[np.float32]:
    """Returns a file of little-endian float32 as (N, `num_columns`).

    Raises:
        DatasetError: If it is missing, empty or cut within a row.
    """
    with reading(path):
        raw = path.read_bytes()
    row_bytes = 4 * num_columns
    if not raw or len(raw) % row_bytes:
        raise DatasetError(f"{path}: is cut short: {len(raw)} bytes, expected rows of {row_bytes}")
    rows = np.frombuffer(raw, dtype="<f4").reshape(-1, num_columns).astype(np.float32)
    # A damaged file may hold NaN of the signaling kind, about which NumPy warns at the first use.
    rows[np.isnan(rows)] = np.nan
    return rows


def read_npz(path: Path, required: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Returns all arrays of an npz file.

    Raises:
        DatasetError: If it is missing or damaged, or lacks a required array.
    """
    with reading(path), open_archive(path) as archive:
        arrays = {name: archive.array(name) for name in archive.names}
    missing = [name for name in required if name not in arrays]
    if missing:
        raise DatasetError(
            f"{path}: has no array {', '.join(missing)}; it has {', '.join(sorted(arrays))}"
        )
    return arrays


def as_type(array: ArrayLike, dtype: DTypeLike) -> NDArray[Any]:
    """Returns numbers of a file in another type.

    Raises:
        ValueError: If they are complex.
        FloatingPointError: If one of them does not exist in that type.
    """
    found = np.asarray(array)
    if np.iscomplexobj(found):
        raise ValueError(f"holds complex numbers ({found.dtype}), expected real ones")
    with np.errstate(over="raise", invalid="raise"):
        return found.astype(dtype)


def stamp_in(name: str, path: Path) -> int:
    """Returns the integer that is a part of a file's name.

    Raises:
        DatasetError: If it is none.
    """
    try:
        return int(name)
    except ValueError:
        raise DatasetError(f"{path}: {name!r} in its name is no stamp") from None
