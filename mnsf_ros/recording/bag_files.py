# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The layout of recordings on disk: their files, metadata.yaml, and drafts."""

import hashlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any, Final

from ruamel.yaml import YAML

from mnsf_ros.errors import RecordingError

METADATA_NAME: Final = "metadata.yaml"
MCAP: Final = ".mcap"
ROS1: Final = ".bag"
COMPRESSED: Final = ".zstd"
SUFFIXES: Final = (MCAP, ".db3", ROS1)
_EXPECTED: Final = "a rosbag2 folder, or a .mcap, .db3 or .bag file"
_END_BYTES: Final = 2**20
_ROOT: Final = "rosbag2_bagfile_information"


def stored_files(path: Path) -> list[Path]:
    """Returns the files with messages at a path, by name; none if there are none.

    The decompressed copy of a compressed file, which `ros2 bag play` leaves, does not count.

    Raises:
        OSError: The folder cannot be read.
    """
    entries = sorted(path.iterdir()) if path.is_dir() else [path]
    stored = [entry for entry in entries if kind_of(entry) in SUFFIXES]
    copies = {entry.with_suffix("") for entry in stored if entry.suffix == COMPRESSED}
    return [entry for entry in stored if entry not in copies]


def kind_of(file: Path) -> str:
    """Returns the suffix of a file, without the suffix of compression."""
    return (file.with_suffix("") if file.suffix == COMPRESSED else file).suffix


def recording_files(path: Path) -> list[Path]:
    """Returns the files with messages at a path, for a recording without a metadata.yaml.

    Raises:
        RecordingError: There is no recording, or the files are of several kinds.
    """
    try:
        files = stored_files(path) if path.exists() else []
        if not files:
            raise RecordingError(f"{path}: {_absence(path)}")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be opened: {error.strerror}") from error
    kinds = sorted({kind_of(file) for file in files})
    if len(kinds) > 1:
        raise RecordingError(
            f"{path}: holds {' and '.join(kinds)} files but no {METADATA_NAME}; name one file"
        )
    return files


def _absence(path: Path) -> str:
    if not path.is_dir():
        what = "is not a recording" if path.exists() else "no such file or folder"
        return f"{what}; expected {_EXPECTED}"
    inside = sorted(entry.name for entry in path.iterdir() if (entry / METADATA_NAME).is_file())
    if inside:
        return f"there are recordings in its subfolders, such as {inside[0]!r}: name one of them"
    return f"holds no recording; expected {_EXPECTED}"


def fingerprint(path: Path) -> dict[str, Any]:
    """Returns the identity of a recording, ready for JSON: sizes, and a hash of the ends of files.

    `metadata.yaml` does not count.

    Raises:
        OSError: A file cannot be read.
    """
    files, ends = stored_files(path), []
    for file in files:
        with file.open("rb") as stream:
            stream.seek(max(0, file.stat().st_size - _END_BYTES))
            ends.append(hashlib.sha256(stream.read()).hexdigest())
    return {
        "num_files": len(files),
        "num_bytes": sum(file.stat().st_size for file in files),
        "hash": hashlib.sha256("".join(sorted(ends)).encode()).hexdigest()[:16],
    }


def read_metadata(folder: Path) -> tuple[list[Path], Counter[str]]:
    """Returns the files that the metadata.yaml of a folder lists, and its counts of messages.

    Raises:
        Exception: One of `UNREADABLE`.
    """
    # Without types: a crafted number in base 60 takes a minute.
    yaml = YAML(typ="base")
    # An anchor may be used again; the warning of it is several lines.
    yaml.composer.warn_double_anchors = False
    content = yaml.load((folder / METADATA_NAME).read_text("utf-8"))[_ROOT]
    counts: Counter[str] = Counter()
    for topic in content["topics_with_message_count"]:
        counts[topic["topic_metadata"]["name"]] += int(topic["message_count"])
    # Whatever folders a path names, only this one is looked into, and once for each file.
    names = [PurePath(path).name for path in content["relative_file_paths"]]
    return [folder / name for name in dict.fromkeys(names)], counts


@contextmanager
def new_folder(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Draft of a recording; moved to `path` when the block ends well, else removed.

    Missing parents are made. If the path ends in `.mcap`, only the mcap file in the folder is moved
    there. An existing recording is replaced at the very end.

    Raises:
        RecordingError: As `check_target`.
        OSError: The folder cannot be made or moved.
    """
    check_target(path, overwrite=overwrite)
    path.parent.mkdir(parents=True, exist_ok=True)
    is_file, prefix = path.suffix == MCAP, f".{path.name}."
    with TemporaryDirectory(prefix=prefix, suffix=".partial", dir=path.parent) as temporary:
        draft = Path(temporary, path.stem if is_file else path.name)
        yield draft
        if is_file:
            (draft,) = draft.glob(f"*{MCAP}")
        check_target(path, overwrite=overwrite)
        replaced = Path(temporary, f"{path.name}.replaced")
        if path.exists():
            path.rename(replaced)
        try:
            draft.rename(path)
        except BaseException:
            if replaced.exists():
                replaced.rename(path)
            raise


def check_target(path: Path, *, overwrite: bool) -> None:
    """Checks the target of a recording before any work is done.

    Raises:
        RecordingError: Something exists there that may not be replaced, or the name has the suffix
            of another format.
    """
    if path.suffix in SUFFIXES and path.suffix != MCAP:
        text = f"is a name of another format; name a folder, or a file that ends in {MCAP}"
        raise RecordingError(f"{path}: {text}")
    if not path.exists() and not path.is_symlink():
        return
    if not overwrite:
        raise RecordingError(f"{path}: exists already; --force replaces it")
    # A wrong path must not cost anybody their other files.
    if path.is_dir() and not path.is_symlink():
        others = _other_files(path)
    else:
        others = [] if path.suffix == MCAP else [path.name]
    if others:
        raise RecordingError(f"{path}: is not replaced: not a recording, or it holds {others[0]!r}")


def _other_files(folder: Path) -> list[str]:
    return sorted(
        entry.name
        for entry in folder.iterdir()
        if not entry.is_file()
        or (entry.name != METADATA_NAME and entry.suffix not in (*SUFFIXES, COMPRESSED))
    )
