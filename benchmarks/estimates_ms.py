# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""CPU of an estimate by the `mnsf_ros` that is on the path: what cost.py runs for two commits.

    PYTHONPATH=CHECKOUT python benchmarks/estimates_ms.py METHOD SWEEPS.npz CHECKOUT

Prints the median in milliseconds. SWEEPS.npz has the points of each sweep, taken at 10 Hz.
"""

import os
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Final

# Before libraries with threads of their own are loaded.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from frame import make_parser

import mnsf_ros
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

_INTERVAL_NS: Final = 100_000_000
# The first estimates have cold caches and know nothing of the past.
WARM_UP: Final = 4


def main() -> None:
    """Prints the median."""
    parser = make_parser(__doc__, has_document=False)
    parser.add_argument("method", metavar="METHOD")
    parser.add_argument("sweeps", metavar="SWEEPS.npz")
    parser.add_argument("checkout", metavar="CHECKOUT")
    options = parser.parse_args()
    if not Path(mnsf_ros.__file__).is_relative_to(options.checkout):
        sys.exit(f"{mnsf_ros.__file__} is measured, expected a file in {options.checkout}")
    with np.load(options.sweeps) as arrays:
        sweeps = [Sweep(arrays[key], _INTERVAL_NS * int(key), "lidar") for key in arrays]
    estimator = make_method(options.method, preset("online").changed({"compute.num_threads": 1}))
    times_ms = []
    for (previous, current), next_ in zip(pairwise(sweeps), sweeps[2:], strict=False):
        triplet = SweepTriplet(previous, current, next_)
        start_s = time.process_time()
        estimator.estimate(triplet)
        times_ms.append(1e3 * (time.process_time() - start_s))
    print(float(np.median(times_ms[WARM_UP:])))


if __name__ == "__main__":
    main()
