# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The files of the recording at a path, and the identity of a recording."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any, Final

from mnsf_ros.errors import RecordingError

if TYPE_CHECKING:
    from pathlib import Path

METADATA_NAME: Final = "metadata.yaml"
MCAP: Final = ".mcap"
ROS1: Final = ".bag"
COMPRESSED: Final = ".zstd"
SUFFIXES: Final = (MCAP, ".db3", ROS1)
_EXPECTED: Final = "a rosbag2 folder, or a .mcap, .db3 or .bag file"
# Files of up to 4 MiB are read as a whole. Of larger ones so many parts, from the first bytes to
# the last: another recording of the same size differs nearly everywhere.
_NUM_PARTS: Final = 64
_PART_BYTES: Final = 65_536


def stored_files(path: Path) -> list[Path]:
    """Returns the files with messages at a path, by name; none if there are none.

    The decompressed copy that `ros2 bag play` leaves beside a compressed file does not count.

    Raises:
        OSError: The folder cannot be read.
    """
    entries = sorted(path.iterdir()) if path.is_dir() else [path]
    stored = [entry for entry in entries if kind_of(entry) in SUFFIXES]
    copies = {entry.with_suffix("") for entry in stored if entry.suffix == COMPRESSED}
    return [entry for entry in stored if entry not in copies]


def kind_of(file: Path) -> str:
    """Returns the suffix that tells the format of a file, also of one compressed as a whole."""
    return (file.with_suffix("") if file.suffix == COMPRESSED else file).suffix


def recording_files(path: Path) -> list[Path]:
    """Returns the files with messages at a path, for a recording without a metadata.yaml.

    Raises:
        RecordingError: There is no recording, or the files are of several kinds.
    """
    try:
        if not path.exists():
            raise RecordingError(f"{path}: no such file or folder; expected {_EXPECTED}")
        files = stored_files(path)
        if not files and not path.is_dir():
            raise RecordingError(f"{path}: is not a recording; expected {_EXPECTED}")
        if not files:
            raise RecordingError(f"{path}: holds no recording; {_content(sorted(path.iterdir()))}")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be opened: {error.strerror}") from error
    kinds = sorted({kind_of(file) for file in files})
    if len(kinds) > 1:
        raise RecordingError(
            f"{path}: holds {' and '.join(kinds)} files but no {METADATA_NAME}; name one file"
        )
    return files


def _content(entries: list[Path]) -> str:
    inside = [entry.name for entry in entries if (entry / METADATA_NAME).is_file()]
    if inside:
        return f"there are recordings in its subfolders {_listed(inside)}: name one of them"
    if not entries:
        return "the folder is empty"
    return f"it contains {_listed([entry.name for entry in entries])}"


def _listed(names: list[str], limit: int = 5) -> str:
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(repr(name) for name in names[:limit]) + more


def storage_files(path: Path) -> list[Path]:
    """Returns the resolved paths of the files with messages of the recording at a path.

    Symbolic links and other spellings of a path give the same. A path without such files, or of
    nothing at all, gives itself.
    """
    path = path.resolve()
    return [file.resolve() for file in stored_files(path)] or [path]


def fingerprint(path: Path) -> dict[str, Any]:
    """Returns the identity of a recording wherever it lies, ready for JSON.

    It is the size of its files with messages and a hash of parts of them; `metadata.yaml` may
    be written again.

    Raises:
        OSError: A file cannot be read.
    """
    files = storage_files(path)
    hashes = sorted(_hash_of_parts(file) for file in files)
    return {
        "num_files": len(files),
        "num_bytes": sum(file.stat().st_size for file in files),
        "hash": hashlib.sha256("".join(hashes).encode()).hexdigest()[:16],
    }


def _hash_of_parts(file: Path) -> str:
    size = file.stat().st_size
    step = max(_PART_BYTES, (size - _PART_BYTES) / (_NUM_PARTS - 1))
    parts = hashlib.sha256()
    with file.open("rb") as stream:
        for number in range(_NUM_PARTS):
            stream.seek(round(number * step))
            parts.update(stream.read(_PART_BYTES))
    return parts.hexdigest()
