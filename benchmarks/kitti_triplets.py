"""Errors on triplets of real sweeps, in the layout of the authors of FNSF and MNSF.

    python benchmarks/kitti_triplets.py [--preset paper] [--seeds 3] [FOLDER]

FOLDER holds npz files with pc1, pc2, pc3 (N, 3) and flow23 (N, 3), and may be given by the
environment variable MNSF_DATA as its parent. The triplets come without ground and cropped, so
ground removal is off. Prints one row per triplet and seed, and the means.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np
from rich.console import Console

from mnsf_ros.evaluation.metrics import by_motion, mean_of
from mnsf_ros.evaluation.tables import errors_table
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.scene_flow import estimate_flow

DATA = Path(os.environ.get("MNSF_DATA", Path(__file__).parents[2] / "shared" / "data"))


def main() -> None:
    """Scores all triplets and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=DATA / "triplets")
    parser.add_argument("--preset", choices=PRESET_NAMES, default="paper")
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    files = sorted(options.folder.glob("*.npz"))
    if not files:
        parser.error(f"{options.folder}: no npz files")
    rows, parts, times_ms = {}, {"all": [], "dynamic": [], "static": []}, {}
    for file in files:
        with np.load(file) as arrays:
            triplet = dict(arrays)
        for seed in range(options.seeds):
            settings = preset(options.preset).changed(
                {"ground.remove": False, "compute.seed": seed}
            )
            estimate = estimate_flow(triplet["pc2"], triplet["pc3"], triplet["pc1"], settings)
            labelled = triplet.get("label_valid", np.ones(len(estimate.flow), bool))
            truth, dynamic = triplet["flow23"], triplet["is_dynamic"]
            errors = by_motion(estimate.flow, truth, dynamic)
            labelled_errors = by_motion(estimate.flow, truth, dynamic, labelled)
            name = f"{file.stem} seed {seed}"
            rows[name], times_ms[name] = errors["all"], estimate.time_ms
            parts["all"].append(errors["all"])
            for part in ("dynamic", "static"):
                parts[part].append(labelled_errors[part])
    rows |= {f"mean, {part}": mean_of(examples) for part, examples in parts.items()}
    times_ms["mean, all"] = float(np.mean(list(times_ms.values())))
    title = f"preset {options.preset}"
    Console(width=120).print(errors_table(rows, title=title, times_ms=times_ms).rich())


if __name__ == "__main__":
    main()
