"""What files say about sweeps, and the one error for all files that do not."""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

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
# More than lidars measure of a point; that many columns and fewer rows are points side by side.
_MAX_COLUMNS: Final = 16


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
    """Parses some columns, counted from 0, of the first rows of a text: (N,) float64 each.

    Raises:
        ValueError: There are fewer rows, a row is too short, or something is no number.
    """
    lines = [line for line in text.splitlines() if not line.isspace() and line][:num_rows]
    if len(lines) < num_rows:
        raise ValueError(f"is cut short: {len(lines)} of {num_rows} rows")
    if not lines:
        return [np.zeros(0) for _ in places]
    return list(np.loadtxt(lines, usecols=tuple(places), ndmin=2, comments=None).T)


@dataclass(frozen=True, eq=False)
class SweepInFile:
    """The points (N, 3) of a file in metres, row for row; those not measured are not finite.

    Where the file does not say, `stamp_ns` is 0 and `pose` (from the sensor to the world) is None.
    """

    xyz: NDArray[np.float32]
    stamp_ns: int = 0
    pose: NDArray[np.float64] | None = None

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(N,) bool, the rows with a finite point."""
        return np.asarray(np.isfinite(self.xyz).all(axis=1))

    def sweep(self) -> Sweep:
        """Returns the measured points as a sweep."""
        xyz = np.ascontiguousarray(self.xyz[self.measured])
        return Sweep(xyz, self.stamp_ns, odometry=self.pose)


def xyz_of_columns(path: Path, columns: Iterable[NDArray[Any]]) -> NDArray[np.float32]:
    """Puts columns x, y and z of numbers, (N,) each, side by side as (N, 3) float32.

    Raises:
        SweepFileError: A column does not hold numbers.
    """
    found = list(columns)
    for name, column in zip("xyz", found, strict=True):
        if column.dtype.kind not in "fiu":
            raise SweepFileError(f"{path}: {name} is of {column.dtype}, expected numbers")
    # Beyond float32 it becomes infinity: a row without a measurement.
    with np.errstate(over="ignore", invalid="ignore"):
        return np.stack([column.astype(np.float32) for column in found], axis=1)


def xyz_of_table(path: Path, name: str, table: NDArray[Any]) -> NDArray[np.float32]:
    """Returns the first three columns of a table, or its fields x, y and z, as (N, 3) float32.

    Raises:
        SweepFileError: The array is no table with so many columns.
    """
    if table.dtype.names is not None:
        return xyz_of_columns(path, (table[axis].ravel() for axis in "xyz"))
    is_table = table.ndim == 2 and table.shape[1] >= 3
    is_transposed = is_table and table.shape[0] < table.shape[1] > _MAX_COLUMNS
    if not is_table or is_transposed:
        hint = ": one row for each point; is it transposed?" if is_transposed else ""
        raise SweepFileError(
            f"{path}: {name} has shape {table.shape}, expected (N, 3) or wider{hint}"
        )
    return xyz_of_columns(path, table.T[:3])


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turns what parsers raise inside the block into a SweepFileError that names the file."""
    try:
        yield
    except UNREADABLE as error:
        raise SweepFileError(f"{path}: cannot be read: {reason(error)}") from error


def read_bytes(path: Path) -> bytes:
    """Returns the content of a file.

    Raises:
        SweepFileError: There is none, or it is empty.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        # A named pipe would keep us waiting for ever.
        raise SweepFileError(f"{path}: is not a regular file")
    with reading(path):
        content = path.read_bytes()
    if not content:
        raise SweepFileError(f"{path}: is empty")
    return content


def triplet_of_files(sweeps: Sequence[SweepInFile]) -> SweepTriplet:
    """Makes a triplet of two sweeps or more in the order of time.

    The last one is the next sweep, the one before it the current one. If these two have poses,
    they say how the sensor moved.

    Raises:
        SweepFileError: There are fewer than two, one has no point, their stamps are out of
            order, or a pose cannot be inverted.
    """
    if len(sweeps) < 2:
        raise SweepFileError(f"got {len(sweeps)} sweeps, expected two at least")
    for number, sweep in enumerate(sweeps, start=1):
        if not sweep.measured.any():
            raise SweepFileError(f"sweep {number} of {len(sweeps)} has no finite point")
    stamps = [sweep.stamp_ns for sweep in sweeps]
    if all(stamps) and stamps != sorted(set(stamps)):
        raise SweepFileError(f"the sweeps are not in the order of time: {stamps} ns")
    *before, current, following = sweeps
    motion = None
    if current.pose is not None and following.pose is not None:
        try:
            motion = np.linalg.inv(following.pose) @ current.pose
        except np.linalg.LinAlgError as error:
            raise SweepFileError(
                f"the pose of the next sweep cannot be inverted: {error}"
            ) from error
    newest_first = [sweep.sweep() for sweep in reversed(before)]
    return SweepTriplet(
        previous=newest_first[0] if newest_first else None,
        current=current.sweep(),
        next=following.sweep(),
        earlier=tuple(newest_first[1:]),
        next_from_current=motion,
    )
