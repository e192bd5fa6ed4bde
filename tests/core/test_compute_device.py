# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Device, precision, threads and memory of networks."""

from __future__ import annotations

import pytest
import torch

from mnsf_ros.core import compute_device as module
from mnsf_ros.core.compute_device import (
    check_device,
    check_memory,
    compute_device,
    layer_precision,
    limit_threads,
    machine_bytes,
)
from mnsf_ros.errors import SettingsError
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.settings import Settings

HAS_CUDA = torch.cuda.is_available()
HUGE_GRID = {"distance.kind": "grid", "distance.max_cells": 2_000_000_000}


def settings_with(**changes):
    return Settings().changed({f"compute.{name}": value for name, value in changes.items()})


def test_device_of_the_settings(device):
    assert compute_device(settings_with(device=device.type).compute) == device
    expected = "cuda" if HAS_CUDA else "cpu"
    assert compute_device(settings_with(device="auto").compute).type == expected


@pytest.mark.skipif(HAS_CUDA, reason="there is CUDA")
@pytest.mark.parametrize("ask", [compute_device, check_device])
def test_cuda_where_there_is_none(ask):
    text = "^compute.device: got 'cuda', but torch finds no usable CUDA device; use auto or cpu$"
    with pytest.raises(SettingsError, match=text):
        ask(settings_with(device="cuda").compute)


@pytest.mark.parametrize(
    ("capabilities", "expected"),
    [
        ({"amx_bf16": True, "avx512_bf16": True}, torch.bfloat16),
        ({"amx_bf16": False, "avx512_bf16": True}, torch.bfloat16),
        ({"amx_bf16": False, "avx512_f": True}, torch.float32),
        (None, torch.float32),  # PyTorch before 2.10
    ],
)
def test_bfloat16_only_where_the_processor_computes_in_it(monkeypatch, capabilities, expected):
    if capabilities is None:
        monkeypatch.delattr(torch.cpu, "get_capabilities", raising=False)
    else:
        monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: capabilities, raising=False)
    asked = settings_with(device="cpu", precision="bfloat16")
    assert layer_precision(asked.compute) is expected
    assert layer_precision(settings_with(device="cpu").compute) is torch.float32


def test_number_of_threads():
    before = torch.get_num_threads()
    try:
        for number in (before + 1, 0):
            limit_threads(settings_with(num_threads=number).compute)
            assert torch.get_num_threads() == before + 1
    finally:
        torch.set_num_threads(before)


@pytest.mark.parametrize(
    ("changes", "needed", "remedy"),
    [
        ({"field.num_hidden_layers": 64, "field.hidden_width": 4096}, 33.8, "field.num_hidden_l"),
        ({"fusion.num_hidden_layers": 64, "fusion.hidden_width": 4096}, 16.9, "field.num_hidden_l"),
        (HUGE_GRID, 18.0, "distance.max_cells"),
    ],
)
def test_more_memory_than_there_is_is_refused_with_both_figures(
    monkeypatch, changes, needed, remedy
):
    monkeypatch.setattr(module, "machine_bytes", lambda: 8 * 10**9)
    settings = settings_with(device="cpu")
    with pytest.raises(SettingsError) as refusal:
        check_memory(settings.changed(changes))
    assert f"need {needed} GB of memory, this machine has 8.0 GB: reduce {remedy}" in str(
        refusal.value
    )
    check_memory(settings.changed(HUGE_GRID | {"distance.kind": "tree"}))
    for name in PRESET_NAMES:
        check_memory(preset(name))


def test_memory_of_the_machine_is_that_of_its_container(monkeypatch, tmp_path):
    limited, unlimited = tmp_path / "limited", tmp_path / "unlimited"
    limited.write_text("3000000\n")
    unlimited.write_text("max\n")
    monkeypatch.setattr(module, "_GROUP_LIMITS", (unlimited, tmp_path / "none"))
    assert machine_bytes() > 3_000_000
    monkeypatch.setattr(module, "_GROUP_LIMITS", (unlimited, limited))
    assert machine_bytes() == 3_000_000
