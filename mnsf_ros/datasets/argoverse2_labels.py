"""Scene flow labels of Argoverse 2, in the layouts of its several tools."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from mnsf_ros.datasets.arrow_tables import feather_columns, read_feather
from mnsf_ros.datasets.errors import DatasetError
from mnsf_ros.datasets.labelled_sweep import GivenFlow
from mnsf_ros.datasets.source_files import as_type, files_in, reading, stamp_in
from mnsf_ros.datasets.surface_classes import argoverse2_classes

if TYPE_CHECKING:
    from pathlib import Path

_FLOW: Final = ("flow_tx_m", "flow_ty_m", "flow_tz_m")
# Names of the same thing in different tools, and the number of the background in each.
_VALID: Final = ("is_valid", "valid", "valid_0")
_DYNAMIC: Final = ("is_dynamic", "dynamic")
_CATEGORY: Final = {"category_indices": 0, "classes": 0, "classes_0": -1}


class FlowLabels:
    """A folder with a Feather file for each sweep but the last, or for the first ones only.

    Files are named by the stamp of their sweep, or counted from 0 or 1, as some tools do.
    """

    def __init__(self, folder: Path, stamps_ns: list[int]) -> None:
        """Finds the file of every sweep.

        Args:
            folder: The folder of a log's labels.
            stamps_ns: Stamps of all sweeps of the log, in order.

        Raises:
            DatasetError: If there is none, or names and stamps do not fit.
        """
        self._folder = folder
        self._files = {stamp_in(file.stem, file): file for file in files_in(folder, "*.feather")}
        unknown = sorted(self._files.keys() - set(stamps_ns))
        if not unknown:
            return
        counts = sorted(self._files)
        num_files = len(counts)
        is_counted = counts[0] in (0, 1) and counts[-1] - counts[0] == num_files - 1
        if not is_counted or num_files >= len(stamps_ns):
            raise DatasetError(
                f"{folder}: {self._files[unknown[0]].name!r} has the stamp of no sweep, and "
                f"{num_files} files cannot be counted off against {len(stamps_ns)} sweeps"
            )
        ordered = [self._files[count] for count in counts]
        self._files = dict(zip(stamps_ns, ordered, strict=False))

    def of_sweep(self, stamp_ns: int, num_points: int) -> GivenFlow | None:
        """Returns the flow of a sweep, None if it has no labels.

        Raises:
            DatasetError: If its file is damaged, or has not one row for each point.
        """
        path = self._files.get(stamp_ns)
        if path is None:
            return None
        found = feather_columns(path)
        valid_name = next((name for name in _VALID if name in found), _VALID[0])
        dynamic_name = next((name for name in _DYNAMIC if name in found), None)
        category_name = next((name for name in _CATEGORY if name in found), None)
        optional = [name for name in (dynamic_name, category_name) if name is not None]
        columns = read_feather(path, [*_FLOW, valid_name, *optional])
        if len(columns[valid_name]) != num_points:
            raise DatasetError(
                f"{path}: has {len(columns[valid_name])} rows for {num_points} points; labels "
                "of a subset of the points (as for the leaderboard) cannot be used"
            )
        class_id = None
        if category_name is not None:
            with reading(path):
                numbers = as_type(columns[category_name], np.int64) - _CATEGORY[category_name]
                class_id = argoverse2_classes(numbers)
        with reading(path):
            return GivenFlow(
                flow=as_type(np.stack([columns[name] for name in _FLOW], axis=1), np.float32),
                valid=columns[valid_name].astype(bool),
                dynamic=None if dynamic_name is None else columns[dynamic_name].astype(bool),
                class_id=class_id,
            )
