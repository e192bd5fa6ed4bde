# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The preset `paper` against the authors' own code, on real sweeps. Skips where they are absent."""

import os
from pathlib import Path

import numpy as np
import pytest

from mnsf_ros.evaluation.metrics import flow_errors
from mnsf_ros.presets import preset
from mnsf_ros.scene_flow import estimate_flow

DATA = Path(os.environ.get("MNSF_DATA", Path(__file__).parents[3] / "shared" / "data"))
FILES = sorted((DATA / "triplets").glob("kitti_0005_*_8192.npz"))

# Mean of the released MNSF code over these four triplets, on 2 CPU cores with an exact DT.
AUTHORS_EPE_M = 0.087
AUTHORS_ACC5 = 0.515


@pytest.mark.slow
@pytest.mark.skipif(len(FILES) != 4, reason="the real triplets are not here")
def test_paper_preset_is_no_worse_than_the_authors_code() -> None:
    errors = []
    for file in FILES:
        triplet = np.load(file)
        # The triplets come without ground.
        settings = preset("paper").changed({"ground.remove": False})
        estimate = estimate_flow(triplet["pc2"], triplet["pc3"], triplet["pc1"], settings)
        errors.append(flow_errors(estimate.flow, triplet["flow23"]))
    assert np.mean([one.epe_m for one in errors]) <= AUTHORS_EPE_M
    assert np.mean([one.acc5 for one in errors]) >= AUTHORS_ACC5
