"""Which files make up the recording at a path."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mnsf_ros.errors import RecordingError

if TYPE_CHECKING:
    from pathlib import Path

METADATA_NAME: Final = "metadata.yaml"
MCAP: Final = ".mcap"
ROS1: Final = ".bag"
SUFFIXES: Final = (MCAP, ".db3", ROS1)
COMPRESSED: Final = ".zstd"
_EXPECTED: Final = "a rosbag2 folder, or a .mcap, .db3 or .bag file"


def stored_files(path: Path) -> list[Path]:
    """Returns the files with messages at a path, by name; none if there are none.

    The decompressed copy that `ros2 bag play` leaves beside a compressed file does not count.

    Raises:
        OSError: The folder cannot be read.
    """
    entries = sorted(path.iterdir()) if path.is_dir() else [path]
    stored = [entry for entry in entries if entry.suffix in (*SUFFIXES, COMPRESSED)]
    copies = {entry.with_suffix("") for entry in stored if entry.suffix == COMPRESSED}
    return [entry for entry in stored if entry not in copies]


def recording_files(path: Path) -> list[Path]:
    """Returns what to open for the recording at a path.

    Args:
        path: A rosbag2 folder, a folder with storage files but without its metadata.yaml, or
            one storage file.

    Returns:
        The folder itself if it has a metadata.yaml, otherwise the storage files.

    Raises:
        RecordingError: There is no recording, or something in it is not a regular file.
    """
    try:
        if not path.exists():
            raise RecordingError(f"{path}: no such file or folder; expected {_EXPECTED}")
        if not path.is_dir() and path.suffix not in SUFFIXES:
            raise RecordingError(f"{path}: is not a recording; expected {_EXPECTED}")
        # To open a named pipe would take for ever.
        for entry in path.iterdir() if path.is_dir() else [path]:
            if entry.exists() and not (entry.is_file() or entry.is_dir()):
                raise RecordingError(f"{path}: {entry.name!r} is not a regular file")
        has_metadata = (path / METADATA_NAME).exists()
        return [path] if has_metadata or path.is_file() else _files_of_folder(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be opened: {error.strerror}") from error


def _files_of_folder(folder: Path) -> list[Path]:
    entries = sorted(folder.iterdir())
    files = [entry for entry in entries if entry.suffix in SUFFIXES and entry.is_file()]
    kinds = sorted({file.suffix for file in files})
    if len(kinds) > 1:
        raise RecordingError(
            f"{folder}: holds {' and '.join(kinds)} files but no {METADATA_NAME}; name one file"
        )
    if not files:
        raise RecordingError(f"{folder}: holds no recording; {_content(entries)}")
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
