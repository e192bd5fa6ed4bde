# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`compute.num_threads` holds for every library that a method calls."""

import numpy as np
import pytest
import torch
from moving_sweeps import QUICK

from mnsf_ros.methods import make_method

edt = pytest.importorskip("edt")

GRID = {"distance.kind": "grid", "ego_motion.removed": True}


@pytest.fixture
def used(monkeypatch):
    """The numbers of threads that the libraries were told; torch gets its own back."""
    before, numbers = torch.get_num_threads(), {"edt": set(), "torch": set()}
    transform = edt.edt

    def told(*arguments, parallel, **others):
        numbers["edt"].add(parallel)
        numbers["torch"].add(torch.get_num_threads())
        return transform(*arguments, parallel=parallel, **others)

    monkeypatch.setattr(edt, "edt", told)
    yield numbers
    torch.set_num_threads(before)


@pytest.mark.parametrize("method", ["mnsf", "fnsf", "online", "ego-estimated"])
def test_no_library_takes_more_threads_than_it_may(translated, used, method):
    flows = []
    for num_threads in (1, 3):
        settings = QUICK.changed(
            {**GRID, "compute.num_threads": num_threads, "optimization.max_iterations": 3}
        )
        flows.append(make_method(method, settings).estimate(translated).flow)
        numbers = {library: max(told) for library, told in used.items() if told}
        if method in ("mnsf", "fnsf"):
            assert numbers["edt"] == numbers["torch"] == num_threads
    if method in ("online", "ego-estimated"):
        np.testing.assert_array_equal(*flows)
