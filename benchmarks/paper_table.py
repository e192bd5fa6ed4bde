# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The paper's tables on four sweeps of KITTI raw drive 0005, beside the authors' own code.

    python benchmarks/paper_table.py [--out benchmark] [--rows mnsf fnsf]

Estimates run on one thread, every triplet from scratch. Each result is appended to OUT/rows.jsonl,
and results that are there are not computed again: interrupt it and start it again as you like, but
use another folder after a change of settings. `--tables` only prints what is there. The data is
looked for beside the checkout, or in the folder MNSF_DATA.

The triplets of 8,192 points are npz files in the layout of the authors of FNSF and MNSF: pc1, pc2,
pc3 (N, 3) and flow23 (N, 3) in metres, without ground, cropped to 80 m and 4 m of height, and
is_dynamic and label_valid (N,). Earlier sweeps are drawn from full ones with the same crop.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

# Before torch is loaded: other programs on the machine keep the other cores.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pandas as pd
from drives import DATA
from frame import Table, make_parser, publish
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.metrics import by_motion, flow_errors
from mnsf_ros.evaluation.task import warm_up
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

MOMENTS: Final = (5, 10, 15, 20)
_NUM_POINTS: Final = 8192
_MAX_RANGE_M, _MAX_HEIGHT_M = 80.0, 4.0
Arrays = dict[str, NDArray[Any]]

# A row is a method, with the settings that make it a variant; PRESET/METHOD has another preset.
# The ablations that are not here are those of `mnsf study`.
ROWS: Final = (
    *("nsfp", "fnsf", "mnsf-no-backward", "mnsf+fusion.kind=mean", "mnsf+fusion.inversion=false"),
    *("mnsf", "mnsf-cycle", "authors/mnsf", "online", "neural"),
)
NUM_SEEDS: Final = 3
# Column of a result, to its title, decimals and factor.
COLUMNS: Final = {
    "epe_m": ("EPE (m)", 3, 1),
    "acc5": ("Acc5 (%)", 1, 100),
    "dynamic_epe_m": ("EPE dynamic", 3, 1),
    "static_epe_m": ("EPE static", 3, 1),
    "time_s": ("time (s)", 1, 1),
}
_KEY: Final = ["row", "seed", "moment"]
# The authors' released solvers with the settings of their README on the same triplets, one seed,
# with an exact distance transform and an exact k-d tree in place of their approximations.
AUTHORS: Final = {
    "nsfp": ("0.071", "50.7", "0.297", "0.073"),
    "fnsf": ("0.066", "54.5", "0.370", "0.050"),
    "mnsf": ("0.087", "51.5", "0.285", "0.073"),
}


@dataclass(frozen=True)
class Job:
    """One estimate."""

    row: str
    seed: int
    moment: int

    @property
    def method(self) -> str:
        """Name of the method, with the settings of a variant."""
        return self.row.rpartition("/")[2]

    @property
    def settings(self) -> Settings:
        """Settings of the preset, for sweeps without ground."""
        changes = {"ground.remove": False, "compute.seed": self.seed, "compute.num_threads": 1}
        return preset(self.row.rpartition("/")[0] or "paper").changed(changes)


@dataclass(frozen=True, eq=False)
class Example:
    """A triplet with the true flow of its current sweep.

    Attributes:
        triplet: Sweeps without ground, with two earlier ones and the ego motion.
        flow: (N, 3) metres to the next sweep.
        dynamic: (N,) bool.
        labelled: (N,) bool; elsewhere movers have no labels and count as static.
    """

    triplet: SweepTriplet
    flow: NDArray[np.float32]
    dynamic: NDArray[np.bool_]
    labelled: NDArray[np.bool_]

    def errors(self, estimate: FlowEstimate) -> dict[str, float]:
        """Errors over all points; EPE also over labelled points that are dynamic, or static."""
        over_all = vars(flow_errors(estimate.flow, self.flow)).items()
        known = (estimate.flow, self.flow, self.dynamic)
        parts = by_motion(*(values[self.labelled] for values in known))
        errors = {name: value for name, value in over_all if name in COLUMNS}
        return errors | {f"{name}_epe_m": parts[name].epe_m for name in ("dynamic", "static")}


def main() -> None:
    """Computes the missing results and prints the tables."""
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, default=Path("benchmark"), metavar="FOLDER")
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=ROWS, metavar="ROW")
    parser.add_argument("--tables", action="store_true", help="only print what is there")
    options = parser.parse_args()
    if missing := [file for file in _files() if not file.is_file()]:
        print(f"Nothing to measure: there is no {missing[0]}. Set MNSF_DATA to the data's folder.")
        return
    file = options.out / "rows.jsonl"
    if not options.tables:
        options.out.mkdir(parents=True, exist_ok=True)
        with suppress(KeyboardInterrupt):
            run(planned(options.rows), file)
    publish("paper", [table(read_rows(file))], options.document)


def planned(rows: Collection[str]) -> list[Job]:
    """Returns the jobs; the first seed of all rows comes first, so the table fills early."""
    return [
        Job(row, seed, moment) for seed in range(NUM_SEEDS) for row in rows for moment in MOMENTS
    ]


def read_rows(file: Path) -> pd.DataFrame:
    """Returns all results; removes a line that an interruption cut off."""
    whole, end, cut = file.read_text().rpartition("\n") if file.exists() else ("", "", "")
    if cut:
        file.write_text(whole + end)
    rows = [json.loads(line) for line in whole.splitlines()]
    return pd.DataFrame(rows, columns=[*_KEY, *COLUMNS])


def run(jobs: Sequence[Job], file: Path) -> None:
    """Computes the results that are not in the file yet, and appends them."""
    done = set(read_rows(file)[_KEY].itertuples(index=False, name=None))
    todo = [job for job in jobs if tuple(vars(job).values()) not in done]
    for number, job in enumerate(todo, start=1):
        try:
            result = measured(job)
        except MnsfError as error:
            text = str(error)
        else:
            with file.open("a") as stream:
                stream.write(json.dumps(vars(job) | result) + "\n")
            text = f"EPE {result['epe_m']:.3f} m, {result['time_s']:.1f} s"
        print(f"{number}/{len(todo)} {' '.join(map(str, vars(job).values()))}: {text}", flush=True)


def measured(job: Job) -> dict[str, float]:
    """Errors and CPU time of one estimate."""
    example = read_example(job.moment)
    estimator = make_method(job.method, job.settings)
    warm_up(job.method, job.settings)
    start_s = time.process_time()
    estimate = estimator.estimate(example.triplet)
    time_s = time.process_time() - start_s
    return example.errors(estimate) | {"time_s": time_s}


def table(rows: pd.DataFrame) -> Table:
    """The rows beside the authors' figures: means over the seeds that have all moments."""
    counts = rows.groupby(_KEY[:2])["moment"].transform("size")
    means = rows[counts == len(MOMENTS)].groupby("row")[list(COLUMNS)].mean()
    lines = []
    for name in ROWS:
        known = means.loc[name] if name in means.index else None
        cells = [
            "" if known is None else f"{factor * known[column]:.{decimals}f}"
            for column, (_, decimals, factor) in COLUMNS.items()
        ]
        lines.append([name, *cells])
        if name in AUTHORS:
            lines.append([f"{name}, authors' code", *AUTHORS[name], ""])
    header = ["8,192 points", *(title for title, _, _ in COLUMNS.values())]
    return Table("Mean over four sweeps of KITTI and the seeds", header, lines)


def read_example(moment: int) -> Example:
    """Returns the example whose current sweep has this number."""
    following, current, previous, *earlier = map(_read, _sweep_files(moment))
    next_from_current = np.linalg.inv(following["pose"]) @ current["pose"]
    three = (previous, current, following)
    arrays = _read(_triplet_file(moment))
    # The triplets have three sweeps; earlier ones are drawn from the full ones, as those were.
    rng = np.random.default_rng(0)
    drawn = [
        item["xyz"][rng.choice(np.flatnonzero(_kept(item)), _NUM_POINTS, replace=False)]
        for item in earlier
    ]
    triplet = SweepTriplet(
        *(
            _sweep(item, arrays[name])
            for item, name in zip(three, ("pc1", "pc2", "pc3"), strict=True)
        ),
        tuple(map(_sweep, earlier, drawn)),
        next_from_current,
    )
    return Example(triplet, arrays["flow23"], arrays["is_dynamic"], arrays["label_valid"])


def _sweep(arrays: Arrays, xyz: NDArray[np.float32]) -> Sweep:
    return Sweep.from_array(xyz, stamp_ns=int(arrays["stamp_ns"]), frame_id="lidar")


def _kept(sweep: Arrays) -> NDArray[np.bool_]:
    xyz = sweep["xyz"]
    near = (np.hypot(xyz[:, 0], xyz[:, 1]) <= _MAX_RANGE_M) & (xyz[:, 2] <= _MAX_HEIGHT_M)
    kept: NDArray[np.bool_] = near & ~sweep["is_ground"]
    return kept


def _read(file: Path) -> Arrays:
    with np.load(file) as content:
        return dict(content)


def _files() -> list[Path]:
    sweeps = [file for moment in MOMENTS for file in _sweep_files(moment)]
    return [*map(_triplet_file, MOMENTS), *sweeps]


def _triplet_file(moment: int) -> Path:
    return DATA / "triplets" / f"kitti_0005_{moment:03d}_{_NUM_POINTS}.npz"


def _sweep_files(moment: int) -> list[Path]:
    """The next sweep, the current one, and three before."""
    return [DATA / "kitti_0005" / f"sweep_{moment + k:03d}.npz" for k in (1, 0, -1, -2, -3)]


if __name__ == "__main__":
    main()
