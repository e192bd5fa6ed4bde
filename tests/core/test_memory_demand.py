# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Settings that need more memory than there is are refused before any of it is taken."""

from __future__ import annotations

import resource

import pytest

from mnsf_ros.core import memory_demand
from mnsf_ros.core.memory_demand import check_memory, machine_bytes
from mnsf_ros.errors import SettingsError
from mnsf_ros.presets import preset
from mnsf_ros.settings import Settings

CPU = Settings().changed({"compute.device": "cpu"})
HUGE_FIELDS = {"field.num_hidden_layers": 64, "field.hidden_width": 4096}
HUGE_FUSION = {"fusion.num_hidden_layers": 64, "fusion.hidden_width": 4096}
HUGE_GRID = {"distance.kind": "grid", "distance.max_cells": 2_000_000_000}


@pytest.fixture
def small_machine(monkeypatch):
    monkeypatch.setattr(memory_demand, "machine_bytes", lambda: 8 * 10**9)


@pytest.mark.parametrize(
    ("changes", "num_points", "needed", "remedy"),
    [
        (HUGE_FIELDS, 0, 33.8, "field.num_hidden_layers, field.hidden_width, fusion"),
        (HUGE_FUSION, 0, 16.9, "fusion.num_hidden_layers, fusion.hidden_width"),
        (HUGE_GRID, 0, 18.0, "distance.max_cells"),
        ({"field.hidden_width": 4096}, 100_000, 16.9, "field.hidden_width, optimization.batch"),
    ],
)
@pytest.mark.usefixtures("small_machine")
def test_what_does_not_fit_is_refused_with_both_figures(changes, num_points, needed, remedy):
    with pytest.raises(SettingsError) as refusal:
        check_memory(CPU.changed(changes), num_points)
    text = str(refusal.value)
    assert f"need {needed} GB of memory, this machine has 8.0 GB: reduce " in text
    assert remedy in text


@pytest.mark.parametrize("name", ["online", "neural", "paper", "authors"])
@pytest.mark.usefixtures("small_machine")
def test_what_fits_is_not(name):
    check_memory(preset(name), 200_000)


@pytest.mark.usefixtures("small_machine")
def test_a_grid_that_nobody_uses_needs_nothing():
    check_memory(CPU.changed(HUGE_GRID | {"distance.kind": "tree"}))


def test_memory_of_the_machine_is_that_of_its_container(monkeypatch, tmp_path):
    limited, unlimited = tmp_path / "limited", tmp_path / "unlimited"
    limited.write_text("3000000000\n")
    unlimited.write_text("max\n")
    whole = machine_bytes()
    assert whole > resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    monkeypatch.setattr(memory_demand, "_GROUP_LIMITS", (unlimited, tmp_path / "none"))
    assert machine_bytes() >= whole
    monkeypatch.setattr(memory_demand, "_GROUP_LIMITS", (unlimited, limited))
    assert machine_bytes() == min(3_000_000_000, machine_bytes())
