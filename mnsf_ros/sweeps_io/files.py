# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Files of data sets and estimates: found, read or refused in one line, and written as a whole.

Every function here raises a DatasetError of one line that names a missing or damaged file.
"""

import json
import os
import secrets
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import ArrayLike, DTypeLike, NDArray

from mnsf_ros.arrays import Floats32
from mnsf_ros.errors import UNREADABLE, DatasetError, reason


@contextmanager
def reading(path: Path, part: str = "") -> Iterator[None]:
    """Turns errors of parsers inside the block into a DatasetError, with file and part.

    A named pipe or a device is refused before the block: reading it might never end.
    """
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise DatasetError(f"{path}: is not a regular file")
        yield
    except (DatasetError, ModuleNotFoundError):
        raise
    except FileNotFoundError as error:
        raise DatasetError(f"{path}: no such file") from error
    except UNREADABLE as error:
        what = f"{part}: {reason(error)}" if part else reason(error)
        raise DatasetError(f"{path}: cannot be read: {what}") from error


@contextmanager
def new_file(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """Draft of a file beside it; moved there when the block ends well, else removed.

    The file must not exist, unless it is to be overwritten; its folder must.
    """
    _check_target(path, overwrite=overwrite)
    draft = path.with_name(f".{path.name}.{secrets.token_hex(4)}.new")
    try:
        yield draft
        with draft.open("rb+") as stream:
            os.fsync(stream.fileno())
        _check_target(path, overwrite=overwrite)
        draft.replace(path)
    except OSError as error:
        raise DatasetError(f"{path}: cannot be written: {reason(error)}") from error
    finally:
        draft.unlink(missing_ok=True)


def _check_target(path: Path, *, overwrite: bool) -> None:
    if path.is_dir():
        raise DatasetError(f"{path}: is a folder, expected the name of a file")
    if path.exists() and not overwrite:
        raise DatasetError(f"{path}: exists already; --force replaces it")
    if not path.absolute().parent.is_dir():
        raise DatasetError(f"{path}: there is no folder {path.parent}")


def files_in(folder: Path, pattern: str) -> list[Path]:
    """Returns the files of a folder that match a pattern, by name, at least one."""
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
    """Returns the wanted name; if that is None, the only one there is."""
    if wanted is None and len(names) == 1:
        return next(iter(names))
    if wanted is not None and wanted in names:
        return wanted
    found = f"{', '.join(sorted(names)[:3])}{', …' if len(names) > 3 else ''}"
    problem = f"several {kind}s, name one" if wanted is None else f"no {kind} {wanted!r}"
    raise DatasetError(f"{place}: holds {problem}; it has {found}")


def read_lines(path: Path) -> list[str]:
    """Returns the lines of an ASCII text."""
    with reading(path):
        return path.read_text("ascii").splitlines()


def read_json(path: Path, kind: type) -> Any:  # noqa: ANN401
    """Returns the content of a JSON file, an object of one kind (dict or list)."""
    with reading(path):
        content = json.loads(path.read_bytes())
        if not isinstance(content, kind):
            raise ValueError(f"holds a {type(content).__name__}, expected a {kind.__name__}")
        return content


def read_float_rows(path: Path, num_columns: int) -> Floats32:
    """Returns a file of little-endian float32 as (N, `num_columns`)."""
    with reading(path):
        raw = path.read_bytes()
    row_bytes = 4 * num_columns
    if not raw or len(raw) % row_bytes:
        raise DatasetError(f"{path}: is cut short: {len(raw)} bytes, expected rows of {row_bytes}")
    return np.frombuffer(raw, dtype="<f4").reshape(-1, num_columns).astype(np.float32)


def read_npz(path: Path, required: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Returns all arrays of an npz file, among them the required ones."""
    with reading(path), path.open("rb") as file:
        archive = np.load(file, allow_pickle=False)
        if not isinstance(archive, NpzFile):
            raise ValueError("is a single array, expected an npz archive")
        with archive:
            found = ", ".join(archive.files) or "none"
            for name in required:
                if name not in archive.files:
                    raise ValueError(f"has no array {name!r}; it has {found}")
            return dict(archive.items())


def read_feather(path: Path, columns: Collection[str]) -> dict[str, NDArray[Any]]:
    """Returns columns of a Feather file as (N,) arrays."""
    from pyarrow import feather

    with reading(path):
        # memory_map: damage in a mapped file would only show later. use_threads: where memory ends,
        # the threads of Arrow abort the process.
        table = feather.read_table(path, memory_map=False, use_threads=False)
        check_columns(table.column_names, columns)
        return {name: table.column(name).to_numpy() for name in columns}


def check_columns(found: Collection[str], wanted: Iterable[str]) -> None:
    """Checks that a table has the wanted columns.

    Raises:
        ValueError: One is missing.
    """
    if missing := [name for name in wanted if name not in found]:
        raise ValueError(f"has no column {', '.join(missing)}; it has {', '.join(found)}")


def as_type(array: ArrayLike, dtype: DTypeLike) -> NDArray[Any]:
    """Returns numbers of a file in another type.

    Raises:
        ValueError: They are complex.
        FloatingPointError: The type cannot hold one of them.
    """
    found = np.asarray(array)
    if np.iscomplexobj(found):
        raise ValueError(f"holds complex numbers ({found.dtype}), expected real ones")
    with np.errstate(over="raise", invalid="raise"):
        return found.astype(dtype)


def stacked(columns: Mapping[str, NDArray[Any]], names: Iterable[str]) -> Floats32:
    """Returns columns (N,) side by side as float32."""
    return as_type(np.stack([columns[name] for name in names], axis=1), np.float32)


def columns_of(
    arrays: Mapping[str, NDArray[Any]], table: Mapping[str, tuple[str, type]]
) -> dict[str, NDArray[Any]]:
    """Returns the arrays of a table (name in the file to our name and type) that are present."""
    return {
        name: as_type(arrays[found], kind)
        for found, (name, kind) in table.items()
        if found in arrays
    }
