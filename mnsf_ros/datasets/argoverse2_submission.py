# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Estimates as a submission to the scene flow challenge of Argoverse 2."""

from __future__ import annotations

import zipfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.datasets.exported_sweep import ExportedSweep
from mnsf_ros.errors import DatasetError
from mnsf_ros.sweeps_io.files import new_file, reading

_COLUMNS: Final = ("flow_tx_m", "flow_ty_m", "flow_tz_m")


class Submission:
    """Writes the sweeps of a challenge into an archive, see `submission`."""

    def __init__(self, archive: zipfile.ZipFile, masks: zipfile.ZipFile) -> None:
        self._archive, self._masks = archive, masks
        self._wanted = {name for name in masks.namelist() if name.endswith(".feather")}
        if not self._wanted:
            raise DatasetError(f"{masks.filename}: holds no mask, LOG/STAMP.feather")

    def write(self, log: str, sweep: ExportedSweep) -> None:
        """Adds a sweep of a log, if the challenge has it.

        Raises:
            DatasetError: Its mask is damaged or of another number of points.
        """
        import pyarrow
        from pyarrow import feather

        name = f"{log}/{sweep.sweep.stamp_ns}.feather"
        if name not in self._wanted or sweep.next_from_current is None:
            return
        chosen = self._mask(name, sweep.sweep.source.num_points)
        flow = sweep.in_rows(sweep.flow)[chosen].astype(np.float16)
        columns: dict[str, Any] = dict(zip(_COLUMNS, flow.T, strict=True))
        columns["is_dynamic"] = sweep.in_rows(sweep.dynamic)[chosen]
        content = BytesIO()
        feather.write_feather(pyarrow.table(columns), content)
        self._archive.writestr(name, content.getvalue())
        self._wanted.discard(name)

    def num_missing(self) -> Counter[str]:
        """Log -> number of its sweeps in the challenge that were not written."""
        return Counter(name.rpartition("/")[0] for name in self._wanted)

    def _mask(self, name: str, num_rows: int) -> NDArray[np.bool_]:
        from pyarrow import feather

        with reading(Path(str(self._masks.filename)), name):
            table = feather.read_table(BytesIO(self._masks.read(name)), use_threads=False)
            mask: NDArray[np.bool_] = table.column(0).to_numpy().astype(bool)
        if len(mask) != num_rows:
            raise DatasetError(
                f"{self._masks.filename}: {name} is for {len(mask)} points, the recorded sweep has "
                f"{num_rows}"
            )
        return mask


@contextmanager
def submission(path: Path, masks: Path, *, overwrite: bool = False) -> Iterator[Submission]:
    """Opens a zip file of one Feather file for each sweep in an archive of masks.

    It appears when the block ends well. The columns are those of `av2.evaluation.scene_flow`:
    `flow_tx_m`, `flow_ty_m`, `flow_tz_m` (float16, metres until the next sweep with ego motion) and
    `is_dynamic`, one row for each point of the mask.

    Raises:
        DatasetError: The masks cannot be read, or the file cannot be written.
    """
    with reading(masks):
        wanted = zipfile.ZipFile(masks)
    with (
        wanted,
        new_file(path, overwrite=overwrite) as draft,
        zipfile.ZipFile(draft, "w") as archive,
    ):
        yield Submission(archive, wanted)
