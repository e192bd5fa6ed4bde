# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which points move, by other programs, on the labelled sweeps of KITTI 0005.

    pip install dufomap==1.1.1 dynamic-object-removal==0.6.0
    python benchmarks/peers.py [--document FILE]

Programs that are not installed are left out. They get the poses of the data and have the settings
that their authors use; `online` finds its poses itself. The data is looked for beside the checkout,
or in the folder MNSF_DATA.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module
from typing import Final

import numpy as np
from drives import DATA, TrueSweep, real_sweeps, triplet_at
from frame import Table, make_parser, publish
from numpy.typing import NDArray
from world_scores import NUM_FIRST

from mnsf_ros.geometry.rigid_motion import transformed
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.kept_points import crop_mask

Masks = list[NDArray[np.bool_]]
Method = Callable[[Sequence[TrueSweep]], Masks]

_KITTI: Final = "kitti_0005"
# Resolution, inflation of hits (m) and of unknown space (cells): of the example in its repository,
# and of the labels for SeFlow.
_DUFOMAP: Final = ((0.1, 0.2, 2), (0.2, 0.2, 1))
# A return at the origin makes dufomap find nothing.
_NEAREST_M: Final = 3.0


def main() -> None:
    """Measures those that are installed and prints the table."""
    options = make_parser(__doc__).parse_args()
    sweeps = real_sweeps(_KITTI)
    if not sweeps:
        print(
            f"Nothing to measure: there is no {DATA / _KITTI}. Set MNSF_DATA to the data's folder."
        )
        return
    publish("peers", [_table(sweeps)], options.document)


def _table(sweeps: Sequence[TrueSweep]) -> Table:
    counted = range(NUM_FIRST, len(sweeps) - 1)
    header = ["", "precision", "recall", "with ground: precision", "recall"]
    rows = []
    for name, method in _methods():
        masks = method(sweeps)
        cells = [
            f"{share:.3f}"
            for with_ground in (False, True)
            for share in _shares(sweeps, masks, counted, with_ground=with_ground)
        ]
        rows.append([name, *cells])
    return Table(f"KITTI 0005, sweeps {counted[0]} to {counted[-1]}", header, rows)


def _shares(
    sweeps: Sequence[TrueSweep], masks: Masks, counted: range, *, with_ground: bool
) -> tuple[float, float]:
    """Precision and recall over the labelled points of the counted sweeps together."""
    counts = np.zeros(3, np.int64)
    for index in counted:
        truth, called = sweeps[index].truth, masks[index]
        judged = truth.valid if with_ground else sweeps[index].scored
        judged = judged & crop_mask(sweeps[index].sweep.xyz, preset("online").crop)
        right = called & truth.dynamic
        counts += [np.count_nonzero(judged & each) for each in (right, called, truth.dynamic)]
    right, called, dynamic = counts.tolist()
    return right / max(called, 1), right / max(dynamic, 1)


def _methods() -> Iterator[tuple[str, Method]]:
    yield "`online`, without poses", _online
    with suppress(ImportError):
        dufomap = import_module("dufomap").dufomap
        for values in _DUFOMAP:
            text = ", ".join(f"{value:g}" for value in values)
            make = partial(dufomap, *values, num_threads=1)
            yield f"`dufomap` ({text}), online", partial(_of_dufomap, make, is_online=True)
            yield f"`dufomap` ({text}), offline", partial(_of_dufomap, make, is_online=False)
    with suppress(ImportError):
        removal = import_module("dynamic_object_removal")
        name = "`dynamic-object-removal`"
        yield f"{name}, `range`", partial(_of_filter, removal.RangeImageGhostFilter)
        yield f"{name}, `temporal`", partial(_of_filter, removal.TemporalConsistencyFilter)


def _online(sweeps: Sequence[TrueSweep]) -> Masks:
    estimator = make_method("online", preset("online"))
    # The first and the last sweep are in no triplet's middle.
    masks = [np.zeros(len(each.sweep), np.bool_) for each in sweeps]
    for index in range(1, len(sweeps) - 1):
        masks[index] = estimator.estimate(triplet_at(sweeps, index)).over_ground.dynamic
    return masks


def _of_dufomap(
    make: Callable[[], object], sweeps: Sequence[TrueSweep], *, is_online: bool
) -> Masks:
    """Online each sweep is judged by those before it and itself, offline by all."""
    dufomap, masks = make(), []
    kept = [np.linalg.norm(each.sweep.xyz, axis=1) > _NEAREST_M for each in sweeps]

    def judge(each: TrueSweep, rows: NDArray[np.bool_]) -> None:
        mask = np.zeros(len(rows), np.bool_)
        mask[rows] = dufomap.segment(each.sweep.xyz[rows], each.pose) == 1
        masks.append(mask)

    for each, rows in zip(sweeps, kept, strict=True):
        dufomap.run(each.sweep.xyz[rows], each.pose)
        if is_online:
            judge(each, rows)
    if not is_online:
        for each, rows in zip(sweeps, kept, strict=True):
            judge(each, rows)
    return masks


def _of_filter(make: Callable[[], object], sweeps: Sequence[TrueSweep]) -> Masks:
    stream = make()
    return [
        ~stream.filter(transformed(each.sweep.xyz, each.pose), each.pose[:3, 3])[1]
        for each in sweeps
    ]


if __name__ == "__main__":
    main()
