# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Files of data sets: found, read and checked, with one line of text for all that goes wrong.

Every function here raises a DatasetError that names the file if that is missing or damaged.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from mnsf_ros.errors import DatasetError
from mnsf_ros.sweeps_io import files
from mnsf_ros.sweeps_io.arrays import open_archive, read_feather_columns

reading = partial(files.reading, kind=DatasetError)


def files_in(folder: Path, pattern: str) -> list[Path]:
    """Returns the files of a folder that fit a pattern, by name, at least one."""
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder")
    found = sorted(file for file in folder.glob(pattern) if file.is_file())
    if not found:
        raise DatasetError(f"{folder}: holds no file {pattern!r}")
    return found


def numbered_files(folder: Path, pattern: str, prefix: str = "") -> dict[int, Path]:
    """Returns files by the integer (a stamp, for example) in their names, in its order."""
    found = {}
    for file in files_in(folder, pattern):
        name = file.stem.removeprefix(prefix)
        try:
            found[int(name)] = file
        except ValueError:
            raise DatasetError(f"{file}: {name!r} in its name is no stamp") from None
    return dict(sorted(found.items()))


def choose(wanted: str | None, names: Collection[str], place: Path, kind: str) -> str:
    """Returns the name that is wanted, or the only one if None is."""
    if wanted is None and len(names) == 1:
        return next(iter(names))
    if wanted is not None and wanted in names:
        return wanted
    found = f"{', '.join(sorted(names)[:3])}{', …' if len(names) > 3 else ''}"
    problem = f"several {kind}s, name one" if wanted is None else f"no {kind} {wanted!r}"
    raise DatasetError(f"{place}: holds {problem}; it has {found}")


def regular(path: Path) -> Path:
    """Returns the path of a file that has an end, unlike named pipes and devices.

    Raises:
        OSError: There is no such file.
        ValueError: It is something else.
    """
    if not path.is_file():
        if path.exists():
            raise ValueError("is not a regular file")
        raise FileNotFoundError(path)
    return path


def file_inside(folder: Path, name: str) -> Path:
    """Returns the path of a file in a folder of the data set, as a file of the data set names it.

    Raises:
        ValueError: The name leads out of the folder.
    """
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts:
        raise ValueError(f"file name {name!r} leads out of the data set, expected a path in it")
    return folder / path


def read_content(path: Path) -> bytes:
    """Returns all bytes of a file that is no larger than a sweep can be."""
    with reading(path):
        return files.content_of(regular(path))


def read_lines(path: Path) -> list[str]:
    """Returns the lines of an ASCII text."""
    content = read_content(path)
    with reading(path):
        return content.decode("ascii").splitlines()


def read_json(path: Path) -> Any:  # noqa: ANN401
    """Returns the content of a JSON file."""
    content = read_content(path)
    with reading(path):
        return json.loads(content)


def read_float_rows(path: Path, num_columns: int) -> NDArray[np.float32]:
    """Returns a file of little-endian float32 as (N, `num_columns`)."""
    raw = read_content(path)
    row_bytes = 4 * num_columns
    if not raw or len(raw) % row_bytes:
        raise DatasetError(f"{path}: is cut short: {len(raw)} bytes, expected rows of {row_bytes}")
    rows = np.frombuffer(raw, dtype="<f4").reshape(-1, num_columns).astype(np.float32)
    # A damaged file may hold NaN of the signaling kind, about which NumPy warns at the first use.
    rows[np.isnan(rows)] = np.nan
    return rows


def read_npz(path: Path, required: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Returns all arrays of an npz file, among them the required ones."""
    with reading(path), open_archive(path) as archive:
        arrays = {name: archive.array(name) for name in archive.names}
    missing = [name for name in required if name not in arrays]
    if missing:
        raise DatasetError(
            f"{path}: has no array {', '.join(missing)}; it has {', '.join(sorted(arrays))}"
        )
    return arrays


def read_feather(
    path: Path, columns: Iterable[str], optional: Iterable[str] = ()
) -> dict[str, NDArray[Any]]:
    """Returns columns of a Feather file as (N,) arrays, the optional ones if they are there."""
    with reading(path):
        return read_feather_columns(regular(path), columns, optional)


def as_type(array: ArrayLike, dtype: DTypeLike) -> NDArray[Any]:
    """Returns numbers of a file in another type.

    Raises:
        ValueError: They are complex.
        FloatingPointError: One of them does not exist in that type.
    """
    found = np.asarray(array)
    if np.iscomplexobj(found):
        raise ValueError(f"holds complex numbers ({found.dtype}), expected real ones")
    with np.errstate(over="raise", invalid="raise"):
        return found.astype(dtype)


def stacked(columns: Mapping[str, NDArray[Any]], names: Iterable[str]) -> NDArray[np.float32]:
    """Returns columns (N,) side by side as float32."""
    return as_type(np.stack([columns[name] for name in names], axis=1), np.float32)


def columns_of(
    arrays: Mapping[str, NDArray[Any]], table: Mapping[str, tuple[str, type]]
) -> dict[str, NDArray[Any]]:
    """Returns the arrays that are there by a table: name in the file -> our name and type."""
    return {
        name: as_type(arrays[found], kind)
        for found, (name, kind) in table.items()
        if found in arrays
    }
