"""Which bytes a recording is made of: whether two of them are the same one."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, Final

from mnsf_ros.recording.bag_files import stored_files

# Files of up to 4 MiB are read as a whole. Of larger ones so many parts, from the first bytes to
# the last: another recording of the same size differs nearly everywhere.
_NUM_PARTS: Final = 64
_PART_BYTES: Final = 65_536


def storage_files(path: Path) -> list[Path]:
    """Returns the resolved paths of the files with messages of the recording at a path.

    Symbolic links and other spellings of a path give the same. A path without such files, or of
    nothing at all, gives itself.
    """
    path = path.resolve()
    return [file.resolve() for file in stored_files(path)] or [path]


def fingerprint(path: Path) -> dict[str, Any]:
    """Returns what tells a recording from others wherever it lies, ready for JSON.

    That is the size of its files with messages and a hash of parts of them; `metadata.yaml` may
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
