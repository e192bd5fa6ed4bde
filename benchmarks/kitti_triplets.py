"""Errors on triplets of real sweeps, in the layout of the authors of FNSF and MNSF.

    python benchmarks/kitti_triplets.py [--methods mnsf,fnsf] [--preset paper] [--seeds 3] [FOLDER]

FOLDER holds npz files with pc1, pc2, pc3 (N, 3) and flow23 (N, 3), and may be given by the
environment variable MNSF_DATA as its parent. The triplets come without ground and cropped, so
ground removal is off. Beside it, the folder of the recording (`kitti_0005` for the triplet
`kitti_0005_010_8192.npz`) may have the sweeps in full: `ego` takes its motion from their poses,
and `mnsf-frames4` and more take the sweeps before. Prints for each method the mean over triplets
and seeds, and before that one row per triplet and seed if there is only one method.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.metrics import FlowErrors, by_motion, mean_of
from mnsf_ros.evaluation.tables import errors_table
from mnsf_ros.methods import make_method
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

DATA = Path(os.environ.get("MNSF_DATA", Path(__file__).parents[2] / "shared" / "data"))
PARTS = ("all", "dynamic", "static")

Arrays = dict[str, NDArray[Any]]
Errors = dict[str, dict[str, FlowErrors]]


def main() -> None:
    """Scores all triplets with all methods and prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=DATA / "triplets")
    parser.add_argument("--methods", default="mnsf", help="names with commas between")
    parser.add_argument("--preset", choices=PRESET_NAMES, default="paper")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    files = sorted(options.folder.glob("*.npz"))
    if not files:
        parser.error(f"{options.folder}: no npz files")
    methods = options.methods.split(",")
    console = Console(width=120)
    means: Errors = {part: {} for part in PARTS}
    mean_times_ms = {}
    for method in methods:
        try:
            rows, times_ms = scores(method, files, options)
        except MnsfError as error:
            console.print(f"{method}: {error}")
            continue
        mean_times_ms[method] = float(np.mean(list(times_ms.values())))
        for part in PARTS:
            means[part][method] = mean_of(rows[part].values())
        if len(methods) == 1:
            console.print(errors_table(rows["all"], times_ms=times_ms).rich())
        else:
            console.print(f"{method}: EPE {means['all'][method].epe_m:.3f} m")
    for part in PARTS:
        title = f"preset {options.preset}, {part} points, mean of {options.seeds} seeds"
        console.print(errors_table(means[part], title=title, times_ms=mean_times_ms).rich())


def scores(
    method: str, files: list[Path], options: argparse.Namespace
) -> tuple[Errors, dict[str, float]]:
    """Errors of each triplet and seed, by part, and wall times in milliseconds."""
    rows: Errors = {part: {} for part in PARTS}
    times_ms = {}
    for file in files:
        with np.load(file) as content:
            arrays = dict(content)
        triplet = triplet_of(arrays, file)
        labelled = arrays.get("label_valid", np.ones(len(triplet.current), bool))
        for seed in range(options.seeds):
            values = {
                "ground.remove": False,
                "compute.seed": seed,
                "compute.num_threads": options.threads,
            }
            estimator = make_method(method, preset(options.preset).changed(values))
            estimate = estimator.estimate(triplet)
            name = f"{file.stem} seed {seed}"
            times_ms[name] = estimate.time_ms
            flows = (estimate.flow, arrays["flow23"], arrays["is_dynamic"])
            # Where nothing is labelled, movers count as static: they do not tell the two apart.
            errors = by_motion(*flows, labelled) | {"all": by_motion(*flows)["all"]}
            for part in PARTS:
                rows[part][name] = errors[part]
    return rows, times_ms


def triplet_of(arrays: Arrays, file: Path) -> SweepTriplet:
    """The triplet of a file, with what else its recording knows."""
    recording, number, num_points = file.stem.rsplit("_", 2)
    folder = file.parents[1] / recording
    sweeps = [Sweep.from_array(arrays[key]) for key in ("pc1", "pc2", "pc3")]
    files = [folder / f"sweep_{int(number) + k:03d}.npz" for k in (1, 0, -2, -3)]
    if not all(path.is_file() for path in files):
        return SweepTriplet(*sweeps)
    following, current, *earlier = (dict(np.load(path)) for path in files)
    rng = np.random.default_rng(0)
    return SweepTriplet(
        *sweeps,
        earlier=tuple(non_ground(sweep, int(num_points), rng) for sweep in earlier),
        next_from_current=np.linalg.inv(following["pose"]) @ current["pose"],
    )


def non_ground(arrays: Arrays, num_points: int, rng: np.random.Generator) -> Sweep:
    """So many points of a full sweep, cropped and without ground as those of the triplets."""
    xyz = arrays["xyz"]
    near = (np.hypot(xyz[:, 0], xyz[:, 1]) <= 80) & (xyz[:, 2] <= 4)
    rows = np.flatnonzero(near & ~arrays["is_ground"])
    return Sweep.from_array(xyz[rng.choice(rows, num_points, replace=False)])


if __name__ == "__main__":
    main()
