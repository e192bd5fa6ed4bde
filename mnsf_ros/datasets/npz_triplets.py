"""Triplets and pairs of sweeps as the authors of NSFP, FNSF and MNSF distribute them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.datasets.labelled_sweep import GivenFlow, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import as_type, files_in, read_npz, reading
from mnsf_ros.errors import DatasetError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mnsf_ros.datasets.formats import ReadOptions

# The files have no stamps, so these are made up.
_FIRST_NS: Final = 1_700_000_000_000_000_000
_INTERVAL_NS: Final = 100_000_000
# Long enough that nobody takes the sweeps of two files for consecutive ones.
_BETWEEN_FILES_NS: Final = 10_000_000_000


def open_sequence(source: Path, _: ReadOptions) -> SweepSource:
    """Opens one file, or a folder of files that are put one after the other.

    Args:
        source: An npz file with pc1, pc2, pc3 and flow23 (flow12), or with pc1, pc2 and flow;
            or a folder of such files, in whatever subfolders.

    Raises:
        DatasetError: If there is none.
    """
    if not source.exists():
        raise DatasetError(f"{source}: no such file or folder")
    files = files_in(source, "**/*.npz") if source.is_dir() else [source]
    num_sweeps = _num_sweeps(read_npz(files[0], ("pc1", "pc2"))) * len(files)
    return SweepSource("lidar", num_sweeps, _sweeps(files))


def _num_sweeps(arrays: Mapping[str, NDArray[Any]]) -> int:
    return 3 if "pc3" in arrays else 2


def _sweeps(files: list[Path]) -> Iterator[LabelledSweep]:
    for number, file in enumerate(files):
        first_ns = _FIRST_NS + number * _BETWEEN_FILES_NS
        arrays = read_npz(file, ("pc1", "pc2"))
        is_triplet = _num_sweeps(arrays) == 3
        flow_names = ("flow12", "flow23", "") if is_triplet else ("flow", "")
        if not any(name in arrays for name in flow_names):
            expected = " or ".join(name for name in flow_names if name)
            raise DatasetError(
                f"{file}: has no flow ({expected}); it has {', '.join(sorted(arrays))}"
            )
        # The labels that some files have beside these are those of the sweep in the middle.
        labelled_flow = "flow23" if is_triplet else "flow"
        for index, flow_name in enumerate(flow_names):
            labels = arrays if flow_name == labelled_flow else {}
            xyz, flow = arrays[f"pc{index + 1}"], arrays.get(flow_name)
            if flow is not None and flow.shape != xyz.shape:
                raise DatasetError(
                    f"{file}: {flow_name} has shape {flow.shape}, expected that of "
                    f"pc{index + 1}, {xyz.shape}"
                )
            with reading(file):
                sweep = _sweep(first_ns + index * _INTERVAL_NS, xyz, flow, labels)
            yield sweep


def _sweep(
    stamp_ns: int,
    xyz: NDArray[Any],
    flow: NDArray[Any] | None,
    labels: Mapping[str, NDArray[Any]],
) -> LabelledSweep:
    given = None
    if flow is not None:
        dynamic = labels.get("is_dynamic")
        given = GivenFlow(
            flow=as_type(flow, np.float32),
            valid=np.ones(len(flow), dtype=bool),
            dynamic=None if dynamic is None else as_type(dynamic, bool),
        )
    labelled = labels.get("label_valid")
    return LabelledSweep(
        stamp_ns=stamp_ns,
        xyz=as_type(xyz, np.float32),
        given=given,
        labelled=None if labelled is None else as_type(labelled, bool),
        # They come without ground, and the lowest of what is left would be taken for it.
        ground=np.zeros(len(xyz), dtype=bool),
    )
