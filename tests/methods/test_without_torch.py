# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""PyTorch takes seconds to import: only methods that fit networks do it."""

import subprocess
import sys

ESTIMATE = """
import sys
import numpy as np
from mnsf_ros.methods import make_method
from mnsf_ros.stream import pipeline as stream_pipeline
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

xyz = np.random.default_rng(0).uniform(-20, 20, (2000, 3)).astype(np.float32)
triplet = SweepTriplet(*(Sweep(xyz, number * 100_000_000) for number in range(3)))
for name in ("online", "zero", "ego-estimated"):
    make_method(name, preset("online")).estimate(triplet)
print(sorted({"torch", "matplotlib"} & set(sys.modules)))

def parts_of_torch():
    return {name for name in sys.modules if name.startswith("torch._")}

mnsf = make_method("mnsf", preset("online"))
loaded = parts_of_torch()
mnsf.estimate(triplet)
print(sorted(parts_of_torch() - loaded))
"""


def run(code):
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout


def test_networks_load_all_of_it_before_their_first_estimate_and_others_nothing():
    assert run(ESTIMATE).split() == ["[]", "[]"]
