# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Submissions to the scene flow challenges of Argoverse 2: a zip of a Feather file for each sweep.

Columns: `flow_tx_m`, `flow_ty_m`, `flow_tz_m` (float16, metres until the next sweep); in 2023 also
`is_dynamic`.
"""

import pickle
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Bools, Floats32
from mnsf_ros.datasets.exported_sweep import ExportedSweep
from mnsf_ros.datasets.open_scene_flow import stamps_ns
from mnsf_ros.errors import DatasetError
from mnsf_ros.sweeps_io.files import new_file, reading

_FLOW: Final = ("flow_tx_m", "flow_ty_m", "flow_tz_m")
_SUFFIX: Final = ".feather"

_Columns = dict[str, NDArray[Any]]
# Name of a log and stamp (ns) -> file in the archive.
_Names = dict[tuple[str, int], str]


class Submission:
    """Writes the sweeps of a challenge into an archive, each with its `columns`."""

    def __init__(
        self,
        archive: zipfile.ZipFile,
        wanted: _Names,
        columns: Callable[[str, ExportedSweep], _Columns],
    ) -> None:
        self._archive, self._wanted, self._columns = archive, wanted, columns

    def write(self, log: str, sweep: ExportedSweep) -> None:
        """Adds a sweep of a log, if the challenge has it.

        Raises:
            DatasetError: Its mask is damaged or of another number of points.
        """
        import pyarrow
        from pyarrow import feather

        key = log, sweep.sweep.stamp_ns
        if key not in self._wanted or sweep.next_from_current is None:
            return
        name, content = self._wanted[key], BytesIO()
        feather.write_feather(pyarrow.table(self._columns(name, sweep)), content)
        self._archive.writestr(name, content.getvalue())
        del self._wanted[key]

    def num_missing(self) -> Counter[str]:
        """Log -> number of its sweeps in the challenge that were not written."""
        return Counter(log for log, _ in self._wanted)


@contextmanager
def submission_2023(path: Path, masks: Path, *, overwrite: bool = False) -> Iterator[Submission]:
    """Opens a submission to the challenge of 2023, of the points of an archive of masks.

    Flow includes the ego motion, as in `av2.evaluation.scene_flow`.

    Raises:
        DatasetError: The masks cannot be read, or the file cannot be written.
    """
    with reading(masks):
        archive = zipfile.ZipFile(masks)
    with archive:

        def columns(name: str, sweep: ExportedSweep) -> _Columns:
            chosen = _mask(archive, name, sweep.sweep.source.num_points)
            dynamic = sweep.in_rows(sweep.dynamic)[chosen]
            return _flow_columns(sweep.in_rows(sweep.flow)[chosen]) | {"is_dynamic": dynamic}

        names = [one for one in archive.namelist() if one.endswith(_SUFFIX)]
        parts = [name.removesuffix(_SUFFIX).rpartition("/") for name in names]
        wanted = {
            (log, int(stamp)): name
            for (log, _, stamp), name in zip(parts, names, strict=True)
            if stamp.isdecimal()
        }
        if not wanted:
            raise DatasetError(f"{masks}: holds no mask, LOG/STAMP.feather")
        with _archive(path, overwrite=overwrite) as target:
            yield Submission(target, wanted, columns)


@contextmanager
def submission_v3(path: Path, index: Path, *, overwrite: bool = False) -> Iterator[Submission]:
    """Opens a submission to the leaderboard of 2026 (v3), of all points of the sweeps of an index.

    Flow is residual: without the ego motion. `index` is `index_eval.pkl`, pairs of scene and stamp.

    Raises:
        DatasetError: The index cannot be read, or the file cannot be written.
    """

    def columns(_: str, sweep: ExportedSweep) -> _Columns:
        return _flow_columns(sweep.in_rows(sweep.residual))

    wanted = {
        (scene, stamp): f"{scene}/{key}{_SUFFIX}"
        for scene, keys in _read_index(index).items()
        for key, stamp in stamps_ns(keys).items()
    }
    with _archive(path, overwrite=overwrite) as target:
        yield Submission(target, wanted, columns)


@contextmanager
def _archive(path: Path, *, overwrite: bool) -> Iterator[zipfile.ZipFile]:
    with new_file(path, overwrite=overwrite) as draft, zipfile.ZipFile(draft, "w") as archive:
        yield archive


def _flow_columns(flow: Floats32) -> _Columns:
    return dict(zip(_FLOW, flow.astype(np.float16).T, strict=True))


def _mask(masks: zipfile.ZipFile, name: str, num_rows: int) -> Bools:
    from pyarrow import feather

    with reading(Path(str(masks.filename)), name):
        table = feather.read_table(BytesIO(masks.read(name)), use_threads=False)
        mask: Bools = table.column(0).to_numpy().astype(bool)
    if len(mask) != num_rows:
        raise DatasetError(
            f"{masks.filename}: {name} is for {len(mask)} points, the recorded sweep has {num_rows}"
        )
    return mask


class _PlainUnpickler(pickle.Unpickler):
    """Reads lists, texts and numbers: a pickle that names a class or function is refused."""

    def find_class(self, module_name: str, global_name: str, /) -> Any:  # noqa: ANN401
        raise pickle.UnpicklingError(f"it names {module_name}.{global_name}, expected texts only")


def _read_index(path: Path) -> Mapping[str, list[str]]:
    """Returns scene to the names of its sweeps, digits each, of an index of OpenSceneFlow."""
    with reading(path), path.open("rb") as file:
        pairs = _PlainUnpickler(file).load()
        found: dict[str, list[str]] = {}
        for scene, key in pairs:
            if not isinstance(scene, str) or "/" in scene or not str(key).isdecimal():
                raise ValueError(f"found {scene!r:.50} and {key!r:.50}, expected scene and stamp")
            found.setdefault(scene, []).append(str(key))
    if not found:
        raise DatasetError(f"{path}: holds no sweep, expected pairs of scene and stamp")
    return found
