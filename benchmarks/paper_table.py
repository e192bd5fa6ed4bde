# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Errors of all methods on KITTI raw drive 0005: whole sweeps, and the triplets of the authors.

    python benchmarks/paper_table.py [--out benchmark] [--quick] [--document FILE]

Runs `mnsf evaluate` in OUT, on one thread and for each seed: interrupt it and start it again as you
like, but use another folder after a change of settings. The data is looked for beside the checkout,
or in the folder MNSF_DATA. The triplets have 8,192 points, without ground, in the layout of the
authors of FNSF and MNSF; every one is estimated from scratch.
"""

import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import pandas as pd
from drives import DATA
from frame import Table, make_parser, publish

_NUM_SEEDS: Final = 3
_MNSF: Final = (sys.executable, "-m", "mnsf_ros.cli")
_WHOLE: Final = ("online", "ego-estimated", "fnsf", "mnsf")
# Ablations are those of `mnsf study`.
_TRIPLETS: Final = ("nsfp", "fnsf", "mnsf", "mnsf-cycle", "authors/mnsf", "online")
_QUICK: Final = ("online",)
# Title of a figure to its decimals.
_DECIMALS: Final = {"EPE (m)": 3, "Acc5 (%)": 1, "dynamic": 3, "static": 3, "time (s)": 1}
# The authors' released solvers with the settings of their README on the same triplets, one seed,
# with an exact distance transform and an exact k-d tree in place of their approximations.
_AUTHORS: Final = {
    "nsfp": ("0.071", "50.7", "0.297"),
    "fnsf": ("0.066", "54.5", "0.370"),
    "mnsf": ("0.087", "51.5", "0.285"),
}


def main() -> None:
    """Computes the missing results and prints the tables."""
    parser = make_parser(__doc__)
    parser.add_argument("--out", type=Path, default=Path("benchmark"), metavar="FOLDER")
    parser.add_argument("--quick", action="store_true", help="online only, one seed")
    options = parser.parse_args()
    if not DATA.is_dir():
        print(f"Nothing to measure: there is no {DATA}. Set MNSF_DATA to the data's folder.")
        return
    publish("paper", tables(options.out, quick=options.quick), options.document)


def tables(out: Path, *, quick: bool) -> Iterator[Table]:
    """Mean errors on whole sweeps, and on the triplets beside the authors' figures."""
    # The first sweeps are left out: `online` has no past there.
    kitti = converted(out, "sweeps", "kitti_0005", "--first", "3")
    means = evaluated(kitti, out / "whole", 0, _QUICK if quick else _WHOLE, "--every", "6")
    yield table("Whole sweeps", means, ("dynamic", "static", "time (s)"))
    # Movers that the camera did not see have no labels and count as static.
    triplets = converted(out, "triplets", "triplets", "--unlabelled-static")
    runs = [
        evaluated(
            triplets,
            out / f"seed_{seed}",
            seed,
            _QUICK if quick else _TRIPLETS,
            *("--set", "ground.remove=false"),
        )
        for seed in range(1 if quick else _NUM_SEEDS)
    ]
    means = pd.concat(runs).groupby(level=0, sort=False).mean()
    yield table("8,192 points", means, ("EPE (m)", "Acc5 (%)", "dynamic", "time (s)"), _AUTHORS)


def converted(out: Path, kind: str, name: str, *options: str) -> Path:
    """A recording of a folder of the data, made once."""
    recording = out / f"{name}.mcap"
    if not recording.exists():
        out.mkdir(parents=True, exist_ok=True)
        _run("convert", kind, str(DATA / name), str(recording), *options)
    return recording


def evaluated(
    recording: Path, out: Path, seed: int, rows: Sequence[str], *options: str
) -> pd.DataFrame:
    """Figures of each row, a method by its name."""
    resume = ("--resume",) if (out / "run.json").exists() else ()
    chosen = ("--methods", ",".join(rows), "--seed", str(seed), *options, *resume)
    _run("evaluate", str(recording), "--out", str(out), "--pictures", "0", *chosen)
    return _figures(out / "results.csv").loc[list(rows)]


def _run(*words: str) -> None:
    subprocess.run([*_MNSF, *words], check=True)


def _figures(results: Path) -> pd.DataFrame:
    """Figures of each method over all recordings."""
    rows = pd.read_csv(results)
    rows = rows[rows["recording"].isna()].set_index("method")
    of_points = {name: rows[rows["points"] == name] for name in ("all", "dynamic", "static")}
    return pd.DataFrame(
        {
            "EPE (m)": of_points["all"]["epe_m"],
            "Acc5 (%)": 100 * of_points["all"]["acc5"],
            "dynamic": of_points["dynamic"]["epe_m"],
            "static": of_points["static"]["epe_m"],
            "time (s)": of_points["all"]["time_ms"] / 1e3,
        }
    )


def table(
    title: str,
    means: pd.DataFrame,
    names: Sequence[str],
    others: dict[str, tuple[str, ...]] | None = None,
) -> Table:
    """A table of some figures, and of those that the authors' code has."""
    lines = []
    for row, figures in means.iterrows():
        lines.append([str(row), *(f"{figures[name]:.{_DECIMALS[name]}f}" for name in names)])
        if others and row in others:
            lines.append([f"{row}, authors' code", *others[str(row)], ""])
    header = [f"EPE {name} (m)" if name in ("dynamic", "static") else name for name in names]
    return Table(f"{title}, mean", ["", *header], lines)


if __name__ == "__main__":
    main()
