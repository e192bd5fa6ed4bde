# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""PyTorch takes seconds to import: only methods that fit networks do it."""

from __future__ import annotations

import subprocess
import sys

ESTIMATE = """
import sys
import numpy as np
from mnsf_ros.methods import make_method
from mnsf_ros.online import online_pipeline
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

xyz = np.random.default_rng(0).uniform(-20, 20, (2000, 3)).astype(np.float32)
sweeps = [Sweep(xyz, number * 100_000_000) for number in range(3)]
for name in sys.argv[1:]:
    estimate = make_method(name, preset("online")).estimate(SweepTriplet(*sweeps))
    assert len(estimate.flow) == len(xyz)
print(sorted({"torch", "matplotlib"} & set(sys.modules)))
"""
BLOCKED = """
import sys
sys.modules["torch"] = None
from mnsf_ros.errors import SettingsError
from mnsf_ros.methods import make_method
from mnsf_ros.settings import Settings
for name, device in (("mnsf", "auto"), ("online", "cuda")):
    try:
        make_method(name, Settings().changed({"compute.device": device}))
    except SettingsError as error:
        print(error)
"""


def run(code, *arguments):
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_methods_that_do_without():
    assert run(ESTIMATE, "online", "zero", "ego-estimated").strip() == "[]"


def test_methods_that_need_it_say_so_where_there_is_none():
    network, device = run(BLOCKED).splitlines()
    assert "mnsf" in network
    assert "torch" in network
    assert "torch" in device


LOADED = """
import sys
import numpy as np
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

make_method("online", preset("online"))
assert "torch" not in sys.modules
mnsf = make_method("mnsf", preset("online"))
loaded = {name for name in sys.modules if name.startswith("torch._")}
xyz = np.random.default_rng(0).uniform(-20, 20, (200, 3)).astype(np.float32)
sweeps = [Sweep(xyz, number * 100_000_000) for number in range(3)]
mnsf.estimate(SweepTriplet(*sweeps))
print(sorted({name for name in sys.modules if name.startswith("torch._")} - loaded))
"""


def test_what_the_first_estimate_of_a_network_needs_is_loaded_before():
    assert run(LOADED).strip() == "[]"
