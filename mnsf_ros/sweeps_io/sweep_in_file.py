"""What a file says about one sweep, and the one error for all files that do not."""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps.sweep import Sweep

# LookupError and TypeError: on files laid out otherwise. MemoryError: a damaged header may ask for
# any size. SyntaxError: NumPy parses headers as Python source, and XML errors are of this kind.
UNREADABLE: Final = (
    OSError,
    EOFError,
    ValueError,
    LookupError,
    TypeError,
    ArithmeticError,
    MemoryError,
    RuntimeError,
    SyntaxError,
    struct.error,
    tokenize.TokenError,
    zlib.error,
    zipfile.BadZipFile,
)
_MAX_LENGTH: Final = 200


def reason(error: BaseException) -> str:
    """Returns what an error says, in one short line without a full stop."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    text = " ".join(str(error).split())[:_MAX_LENGTH].rstrip(".")
    if isinstance(error, LookupError):
        # A KeyError's text is only the key.
        return f"it has no {text}" if isinstance(error, KeyError) else f"index error: {text}"
    return text or type(error).__name__


def parse_rows(text: bytes, num_rows: int, places: Sequence[int]) -> list[NDArray[Any]]:
    """Parses some columns of the first rows.

    Args:
        text: Rows, with blanks between the numbers.
        num_rows: Rows to parse.
        places: Columns wanted, counted from 0.

    Returns:
        The columns, (N,) float64 each.

    Raises:
        ValueError: If there are fewer rows, a row is too short, or something is no number.
    """
    lines = [line for line in text.splitlines() if not line.isspace() and line][:num_rows]
    if len(lines) < num_rows:
        raise ValueError(f"is cut short: {len(lines)} of {num_rows} rows")
    if not lines:
        return [np.zeros(0) for _ in places]
    return list(np.loadtxt(lines, usecols=tuple(places), ndmin=2, comments=None).T)


# More than lidars measure of a point; that many columns and fewer rows are points side by side.
_MAX_COLUMNS: Final = 16


@dataclass(frozen=True, eq=False)
class SweepInFile:
    """The points of a file, row for row, before anything is left out.

    Attributes:
        xyz: (N, 3) float32, metres; rows without a measurement are not finite.
        stamp_ns: Time of the sweep, integer nanoseconds; 0 where the file does not say.
        pose: (4, 4) from the sensor to the world; None where the file does not say.
    """

    xyz: NDArray[np.float32]
    stamp_ns: int = 0
    pose: NDArray[np.float64] | None = None

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(N,) bool, the rows with a finite point."""
        return np.asarray(np.isfinite(self.xyz).all(axis=1))

    def sweep(self) -> Sweep:
        """The measured points as a sweep."""
        xyz = np.ascontiguousarray(self.xyz[self.measured])
        return Sweep(xyz, self.stamp_ns, odometry=self.pose)


def xyz_of_columns(path: Path, columns: list[NDArray[Any]]) -> NDArray[np.float32]:
    """Puts three columns of numbers, (N,) each, side by side as (N, 3) float32.

    Raises:
        SweepFileError: If a column does not hold numbers.
    """
    for name, column in zip("xyz", columns, strict=True):
        if column.dtype.kind not in "fiu":
            raise SweepFileError(f"{path}: {name} is of {column.dtype}, expected numbers")
    # Beyond float32 it becomes infinity: a row without a measurement.
    with np.errstate(over="ignore", invalid="ignore"):
        return np.stack([column.astype(np.float32) for column in columns], axis=1)


def xyz_of_table(path: Path, name: str, table: NDArray[Any]) -> NDArray[np.float32]:
    """The first three columns of an array with at least three, (N, 3) float32.

    An array of rows with named fields has to name x, y and z.

    Raises:
        SweepFileError: If the array is not of that kind.
    """
    if table.dtype.names is not None:
        return xyz_of_columns(path, [table[axis].ravel() for axis in "xyz"])
    if table.ndim != 2 or table.shape[1] < 3:
        raise SweepFileError(f"{path}: {name} has shape {table.shape}, expected (N, 3) or wider")
    if table.shape[0] < table.shape[1] > _MAX_COLUMNS:
        raise SweepFileError(
            f"{path}: {name} has shape {table.shape}, expected (N, 3) or wider: one row for each "
            "point; is it transposed?"
        )
    return xyz_of_columns(path, [table[:, axis] for axis in range(3)])


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turns what parsers raise inside the block into a SweepFileError that names the file."""
    try:
        yield
    except UNREADABLE as error:
        raise SweepFileError(f"{path}: cannot be read: {reason(error)}") from error


def read_bytes(path: Path) -> bytes:
    """The content of a file.

    Raises:
        SweepFileError: If there is none, or it is empty.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        # A named pipe would keep us waiting for ever.
        raise SweepFileError(f"{path}: is not a regular file")
    with reading(path):
        content = path.read_bytes()
    if not content:
        raise SweepFileError(f"{path}: is empty")
    return content
