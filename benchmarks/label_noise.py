# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How far the labels of real movers jump from sweep to sweep: what bounds errors measured by them.

    python benchmarks/label_noise.py

Vehicles do not change their motion by centimetres within a tenth of a second. So the motion that
the labels of KITTI 0005 give to a mover in each sweep is compared with a line through those of five
sweeps around it. What remains is noise of boxes and poses: no method has less error than this.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from online_recordings import TrueSweep, real_sweeps
from rich.console import Console

from mnsf_ros.report.text_table import TextTable
from mnsf_ros.sweeps.sweep import NANOSECONDS

_NUM_BESIDE: Final = 2
_MIN_POINTS: Final = 20


def main() -> None:
    """Prints the noise of each labelled mover of the reported half."""
    raw = argparse.RawDescriptionHelpFormatter
    argparse.ArgumentParser(description=__doc__, formatter_class=raw).parse_args()
    sweeps = real_sweeps("kitti_0005")
    motions: dict[int, dict[int, NDArray[np.float64]]] = {}
    for index, (current, next_) in enumerate(pairwise(sweeps)):
        is_mover = current.scored & current.dynamic & (current.body >= 0)
        for body in np.unique(current.body[is_mover]):
            own = is_mover & (current.body == body)
            if np.count_nonzero(own) >= _MIN_POINTS:
                motions.setdefault(int(body), {})[index] = _velocity(current, next_, own)
    rows = []
    for body, velocities in motions.items():
        noise = [
            velocity - _smoothed(velocities, index)
            for index, velocity in velocities.items()
            if index >= len(sweeps) // 2
        ]
        if noise:
            lengths, level = (
                np.linalg.norm(each, axis=1) for each in (noise, np.delete(noise, 2, 1))
            )
            cells = [f"{np.median(each):.2f}" for each in (lengths, level)]
            rows.append([str(body), str(len(noise)), *cells, f"{lengths.mean() / 10:.3f}"])
    header = ["mover", "sweeps", "velocity (m/s)", "of it level (m/s)", "per sweep (m)"]
    Console().print(TextTable(header, rows, "Noise of labels, KITTI 0005, reported half"))


def _velocity(current: TrueSweep, next_: TrueSweep, own: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Returns (3,) m/s, the mean velocity of some points over ground, world."""
    before = current.sweep.xyz[own].astype(np.float64)
    here = before @ current.pose[:3, :3].T + current.pose[:3, 3]
    there = (before + current.flow[own]) @ next_.pose[:3, :3].T + next_.pose[:3, 3]
    elapsed_s = (next_.sweep.stamp_ns - current.sweep.stamp_ns) / NANOSECONDS
    velocity: NDArray[np.float64] = (there - here).mean(axis=0) / elapsed_s
    return velocity


def _smoothed(velocities: dict[int, NDArray[np.float64]], index: int) -> NDArray[np.float64]:
    """Returns (3,) m/s, what a line through the sweeps around one says of it."""
    near = [each for each in velocities if abs(each - index) <= _NUM_BESIDE]
    places = np.array(near, dtype=float) - index
    degree = min(1, len(near) - 1)
    line = np.polyfit(places, np.array([velocities[each] for each in near]), degree)
    return np.asarray(line[-1], dtype=np.float64)


if __name__ == "__main__":
    main()
