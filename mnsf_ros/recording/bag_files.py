"""Which files make up the recording at a path."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mnsf_ros.errors import RecordingError

if TYPE_CHECKING:
    from pathlib import Path

METADATA_NAME: Final = "metadata.yaml"
SUFFIXES: Final = (".mcap", ".db3", ".bag")
_EXPECTED: Final = "a rosbag2 folder, or a .mcap, .db3 or .bag file"


def recording_files(path: Path) -> list[Path]:
    """Return what to open for the recording at a path.

    Args:
        path: A rosbag2 folder, a folder with storage files but without its metadata.yaml, or
            one storage file.

    Returns:
        The folder itself if it has a metadata.yaml, otherwise the storage files.

    Raises:
        RecordingError: There is no recording.
    """
    try:
        if path.is_dir():
            return _files_of_folder(path)
        if not path.exists():
            raise RecordingError(f"{path}: no such file or folder; expected {_EXPECTED}")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be opened: {error.strerror}") from error
    if path.suffix not in SUFFIXES:
        raise RecordingError(f"{path}: is not a recording; expected {_EXPECTED}")
    return [path]


def _files_of_folder(folder: Path) -> list[Path]:
    entries = sorted(folder.iterdir())
    if any(entry.name == METADATA_NAME for entry in entries):
        return [folder]
    files = [entry for entry in entries if entry.suffix in SUFFIXES and entry.is_file()]
    kinds = sorted({entry.suffix for entry in files})
    if len(kinds) > 1:
        raise RecordingError(
            f"{folder}: holds {' and '.join(kinds)} files but no {METADATA_NAME}; name one file"
        )
    if files:
        return files
    raise RecordingError(f"{folder}: holds no recording; {_content(entries)}")


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
