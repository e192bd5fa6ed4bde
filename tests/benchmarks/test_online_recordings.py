# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The drives that the live node is measured on."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def recordings(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    return importlib.import_module("online_recordings")


@pytest.mark.parametrize("rate_hz", [10, 20])
def test_a_drive_goes_on_at_its_speed_from_the_first_to_the_last_sweep(recordings, rate_hz):
    sweeps = list(recordings.simulated_drive(0, 30, rate_hz=rate_hz, num_beams=16, num_columns=36))
    assert len(sweeps) == 30
    stamps_ns = [item.sweep.stamp_ns for item in sweeps]
    np.testing.assert_array_equal(np.diff(stamps_ns), 10**9 // rate_hz)
    places = np.stack([item.pose[:3, 3] for item in sweeps])
    assert np.linalg.norm(np.diff(places, axis=0), axis=1) * rate_hz == pytest.approx(8, abs=0.3)


def test_to_and_fro_passes_both_ends_once(recordings):
    assert recordings.to_and_fro("abcd") == list("abcdcb")
    assert recordings.to_and_fro([]) == []
