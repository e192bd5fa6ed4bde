"""The flow of one sweep in a file: npz, npy or ply. Row i belongs to row i of the sweep's file."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.settings import SettingValue

_PLY_COLUMNS: Final = ("x", "y", "z", "flow_x", "flow_y", "flow_z")


@dataclass(frozen=True, eq=False)
class FlowToWrite:
    """What is written: points (N, 3) of the current sweep and their flow (N, 3), both in metres.

    The flow is NaN where there is no point. `kept` (N,) are the points inside the crop that are not
    ground, `settings` have full names.
    """

    xyz: NDArray[np.float32]
    flow: NDArray[np.float32]
    kept: NDArray[np.bool_]
    method: str = ""
    settings: Mapping[str, SettingValue] = field(default_factory=dict)


def check_target(path: Path, *, overwrite: bool) -> None:
    """Says before the work whether a flow can be written there.

    Raises:
        SweepFileError: The ending names no format, or a file is there that may not be replaced.
    """
    if path.suffix.lower() not in WRITERS:
        raise SweepFileError(f"{path}: expected a file that ends with {', '.join(WRITERS)}")
    if path.is_dir() or (path.exists() and not overwrite):
        raise SweepFileError(f"{path}: exists already")
    if not path.absolute().parent.is_dir():
        raise SweepFileError(f"{path}: there is no folder {path.parent}")


def write_flow(path: Path, flow: FlowToWrite, *, overwrite: bool = False) -> None:
    """Writes the file complete, or not at all.

    Raises:
        SweepFileError: It cannot be written, or a file is there that may not be replaced.
    """
    check_target(path, overwrite=overwrite)
    draft = path.with_name(f".{path.name}.{secrets.token_hex(4)}.new")
    try:
        with draft.open("xb") as stream:
            WRITERS[path.suffix.lower()](stream, flow)
            stream.flush()
            os.fsync(stream.fileno())
        if overwrite:
            draft.replace(path)
        else:
            _put_in_place(draft, path)
    except FileExistsError as error:
        raise SweepFileError(f"{path}: exists already") from error
    except OSError as error:
        raise SweepFileError(f"{path}: cannot be written: {error.strerror}") from error
    finally:
        draft.unlink(missing_ok=True)


def _put_in_place(draft: Path, path: Path) -> None:
    """Gives the draft its name, unless a file got that name meanwhile: FileExistsError."""
    try:
        # Unlike a rename, a link never replaces anything.
        path.hardlink_to(draft)
    except FileExistsError:
        raise
    except OSError:
        # A file system without hard links.
        check_target(path, overwrite=False)
        draft.rename(path)


def _write_npz(stream: IO[bytes], flow: FlowToWrite) -> None:
    np.savez_compressed(
        stream,
        xyz=flow.xyz,
        flow=flow.flow,
        kept=flow.kept,
        method=np.array(flow.method),
        settings=np.array(json.dumps(dict(flow.settings))),
    )


def _write_npy(stream: IO[bytes], flow: FlowToWrite) -> None:
    np.save(stream, flow.flow)


def _write_ply(stream: IO[bytes], flow: FlowToWrite) -> None:
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment flow of {flow.method}: metres until the next sweep",
        f"element vertex {len(flow.xyz)}",
        *(f"property float {name}" for name in _PLY_COLUMNS),
        "end_header\n",
    ]
    stream.write("\n".join(header).encode())
    stream.write(np.hstack([flow.xyz, flow.flow]).astype("<f4").tobytes())


WRITERS: Final[Mapping[str, Callable[[IO[bytes], FlowToWrite], None]]] = {
    ".npz": _write_npz,
    ".npy": _write_npy,
    ".ply": _write_ply,
}
