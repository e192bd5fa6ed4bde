# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Predictions of another program in files, as a method: `file:FOLDER`.

Two layouts are read. Both have one file for each sweep, named by its stamp in nanoseconds, in the
folder itself or in a subfolder named as the recording is in the results, such as `street`, or
`a/street` where there is another street:

* `STAMP.npz` with `flow` (N, 3) metres until the next sweep, in the axes of `docs/recordings.md`;
* `STAMP.feather` with flow_tx_m, flow_ty_m, flow_tz_m, the submission layout of Argoverse 2.

Row i belongs to row i of the recorded cloud, with all of its points, whatever part of them is
evaluated. A submission to Argoverse 2 has rows only for the points of the challenge's mask: name
the folder of the masks, too (`file:FOLDER::MASKS`). It is scored on these points alone, other
methods of the same run on all of theirs.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.errors import MethodError, SettingsError
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet
from mnsf_ros.sweeps_io.files import array_in, open_npz, read_feather_columns, reading

FILE_PREFIX: Final = "file:"
_COLUMNS: Final = ("flow_tx_m", "flow_ty_m", "flow_tz_m")


class PredictionFiles:
    """Looks flow up instead of estimating it."""

    traits = MethodTraits(is_external=True, is_timed=False)

    def __init__(self, folders: str, settings: Settings) -> None:
        """Names the folder.

        Args:
            folders: `FOLDER` or `FOLDER::MASKS`.
            settings: Not used.

        Raises:
            SettingsError: There is no such folder.
        """
        self._folders = folders
        self.settings = settings
        folder, _, masks = folders.partition("::")
        self._folder = _existing(folder)
        self._masks = _existing(masks) if masks else None

    def with_settings(self, settings: Settings) -> PredictionFiles:
        """Returns the same with other settings."""
        return PredictionFiles(self._folders, settings)

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Returns the predicted flow of the current sweep, which must be a recorded one.

        Raises:
            MethodError: There is no prediction, or it does not fit the sweep.
        """
        current = triplet.current
        # The points of a recorded sweep know their rows in its cloud.
        cloud: Any = current.source
        if not hasattr(cloud, "rows"):
            raise MethodError("predictions from files are of recorded sweeps only")
        mask = self._mask(current, cloud.num_points)
        file = _file_of(self._folder, current)
        flow = _read_flow(file)
        _check_rows(file, flow, int(np.count_nonzero(mask)))
        everywhere = np.full((cloud.num_points, 3), np.nan, dtype=np.float32)
        everywhere[mask] = flow
        # Only the points whose flow is asked for need a finite prediction.
        asked = np.ones(len(current), dtype=bool) if current.kept is None else current.kept
        return FlowEstimate(everywhere[cloud.rows], kept=mask[cloud.rows] & asked)

    def _mask(self, current: Sweep, num_points: int) -> NDArray[np.bool_]:
        """The points (N,) of the cloud that have a prediction."""
        if self._masks is None:
            return np.ones(num_points, dtype=bool)
        file = _file_of(self._masks, current)
        mask: NDArray[np.bool_] = _read_columns(file, ("mask",))[:, 0] != 0
        _check_rows(file, mask, num_points)
        return mask


def _existing(folder: str) -> Path:
    path = Path(folder)
    if not folder or not path.is_dir():
        raise SettingsError(f"{FILE_PREFIX}{folder}: there is no such folder of predictions")
    return path


def _file_of(folder: Path, sweep: Sweep) -> Path:
    # A name that is a whole path leads nowhere but into the folder.
    parts = [part for part in Path(sweep.source.recording).parts if part not in ("/", "..")]
    places = [
        parent / f"{sweep.stamp_ns}{suffix}"
        for parent in (folder.joinpath(*parts), folder)
        for suffix in (".npz", ".feather")
    ]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise MethodError(
            f"{folder}: no prediction for stamp {sweep.stamp_ns}; expected for example {places[0]}"
        )
    return found


def _read_flow(file: Path) -> NDArray[np.float32]:
    if file.suffix == ".feather":
        return _read_columns(file, _COLUMNS)
    with reading(file, kind=MethodError), open_npz(file) as archive:
        flow = array_in(archive, "flow")
    if flow.ndim != 2 or flow.shape[1] != 3 or flow.dtype.kind not in "fiu":
        raise MethodError(
            f"{file}: flow has shape {flow.shape} of {flow.dtype}, expected (N, 3) numbers"
        )
    with np.errstate(over="ignore"):
        return flow.astype(np.float32)


def _read_columns(file: Path, names: tuple[str, ...]) -> NDArray[np.float32]:
    with reading(file, kind=MethodError):
        columns = read_feather_columns(file, names).values()
        return np.stack(list(columns), axis=1).astype(np.float32)


def _check_rows(file: Path, rows: NDArray[Any], expected: int) -> None:
    if len(rows) != expected:
        raise MethodError(f"{file}: has {len(rows)} rows, its cloud has {expected} points")
