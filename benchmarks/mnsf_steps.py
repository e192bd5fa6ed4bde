# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What each choice of the live method `mnsf` buys: errors and CPU with another one.

    python benchmarks/mnsf_steps.py [--seeds A B] [--workers N] [--cache DIR] [--document FILE]

On the second half of KITTI 0005, if the shared data is there (see drives.py), and on random worlds
for tuning, which movers.py makes, too. With one worker the CPU times are undisturbed.
"""

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np
import pandas as pd
from drives import TrueSweep, kept_world, real_sweeps
from frame import Table, make_parser, publish
from movers import DURATION_S, KITTI, add_world_options, in_processes
from world_scores import NUM_FIRST, found_share, scored

from mnsf_ros.evaluation.summary import summarize
from mnsf_ros.methods.live_mnsf import LiveMnsfEstimator
from mnsf_ros.online.preparation import PreparedSweeps

_NUM_SWEEPS: Final = 24
_COLD: Final = "mnsf+warm_start.enabled=false"
_DEEP: Final = "field.num_hidden_layers=8+field.hidden_width=128"
_DEEP_FUSION: Final = "fusion.num_hidden_layers=3+fusion.hidden_width=128"
# Row to method.
_VARIANTS: Final = {
    "`mnsf`": "mnsf",
    "cold, 10 steps": f"{_COLD}+live.first_iterations=10",
    "cold, 40 steps": _COLD,
    "5 steps": "mnsf+optimization.max_iterations=5",
    "20 steps": "mnsf+optimization.max_iterations=20",
    "512 points a step": "mnsf+optimization.max_points=512",
    "all points": "mnsf+optimization.max_points=0",
    "mean as fusion": "mnsf+fusion.kind=mean",
    "no encoding": "mnsf+live.num_octaves=0",
    "truncation 0.5 m": "mnsf+distance.truncation_m=0.5",
    "truncation 2 m": "mnsf+distance.truncation_m=2",
    "networks of the paper's size": f"mnsf+{_DEEP}+{_DEEP_FUSION}",
    "`online`": "online",
}
_find_motions: Final = LiveMnsfEstimator.find_motions


def _with_fresh_networks(estimator: LiveMnsfEstimator, *given: Any) -> Any:  # noqa: ANN401 - passed
    """Cold without the loss of tracks, which `warm_start.enabled` costs, too."""
    estimator._networks = None
    return _find_motions(estimator, *given)


# Row to what is replaced in `mnsf`: owner, name and value.
_PATCHES: Final[dict[str, tuple[Any, str, Any]]] = {
    "cold, 40 steps, with tracks": (LiveMnsfEstimator, "find_motions", _with_fresh_networks),
    "no older sweeps": (PreparedSweeps, "past", lambda *_: []),
}


def main() -> None:
    """Measures all rows, prints the table, and writes it into a document."""
    parser = make_parser(__doc__)
    add_world_options(parser, (700, 708))
    options = parser.parse_args()
    publish("mnsf-steps", _tables(options.seeds, options.workers, options.cache), options.document)


def _tables(seeds: Sequence[int], num_workers: int, cache: Path) -> Iterator[Table]:
    tasks = [(KITTI, cache), *((str(seed), cache) for seed in range(*seeds))]
    kitti, *worlds = in_processes(_figures, tasks, num_workers)
    # Means over worlds beside the real drive.
    means = pd.concat(worlds).groupby(level=0, sort=False).mean()
    parts = {"worlds": means} if kitti.empty else {KITTI: kitti, "worlds": means}
    table = pd.concat(parts, axis=1).loc[means.index]
    header = ["", *(f"{part}: {name}" for part, name in table)]
    rows = [
        # Errors and shares to the third digit, times without.
        [row, *(f"{value:.{0 if value > 10 else 3}f}" for value in values)]
        for row, values in zip(table.index, table.to_numpy(), strict=True)
    ]
    title = f"{KITTI}, second half; random worlds, seeds {seeds[0]} to {seeds[1] - 1}, means"
    yield Table(title, header, rows)


def _figures(drive: str, cache: Path) -> pd.DataFrame:
    """Figures of all rows on KITTI or on the world of a seed; empty without data."""
    if drive == KITTI:
        sweeps = real_sweeps("kitti_0005")[:_NUM_SWEEPS]
        counted = range(len(sweeps) // 2, len(sweeps) - 1)
    else:
        sweeps = kept_world(int(drive), DURATION_S, "random", cache).sweeps
        counted = range(NUM_FIRST, len(sweeps) - 1)
    lines = {}
    for row in (*_VARIANTS, *_PATCHES) if sweeps else ():
        with patch.object(*_PATCHES[row]) if row in _PATCHES else nullcontext():
            lines[row] = _line(_VARIANTS.get(row, "mnsf"), sweeps, counted)
    return pd.DataFrame.from_dict(lines, orient="index")


def _line(method: str, sweeps: list[TrueSweep], counted: range) -> dict[str, float]:
    run = list(scored(method, sweeps, counted, method=method))
    summary = summarize(one.row for one in run).iloc[0]
    return {
        "EPE dynamic (m)": summary["errors.dynamic.epe_m"],
        "EPE static (m)": summary["errors.static.epe_m"],
        "movers found": found_share(item for one in run for item in one.row.movers.objects),
        "CPU (ms)": float(np.median([one.cpu_ms for one in run])),
    }


if __name__ == "__main__":
    main()
