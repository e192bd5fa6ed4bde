# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What each choice of the live method buys: rows, and their figures."""

import pandas as pd
import pytest

from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset


def test_every_row_is_a_method_with_settings_of_its_own(load):
    variants = load("mnsf_steps")._VARIANTS
    settings = [str(make_method(name, preset("online")).settings) for name in variants.values()]
    assert len(set(settings)) == len(variants)


@pytest.mark.slow
def test_rows_have_figures_of_worlds(load, monkeypatch, tmp_path):
    steps = load("mnsf_steps")
    monkeypatch.setattr(steps, "DURATION_S", 0.8)
    monkeypatch.setattr(steps, "_VARIANTS", {"`mnsf`": "mnsf"})
    own = steps._figures("22", tmp_path)
    assert list(own.index) == ["`mnsf`", *steps._PATCHES]
    assert own["EPE dynamic (m)"].nunique() == len(own)  # each row is another method
    monkeypatch.setattr(steps, "in_processes", lambda *_: [pd.DataFrame(), own, own])
    (table,) = steps._tables((22, 24), 1, tmp_path)
    assert table.header[1:] == [f"worlds: {name}" for name in own]
    assert [row[0] for row in table.rows] == list(own.index)
