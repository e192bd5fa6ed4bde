# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Device, precision and threads of networks."""

import sys

import pytest
import torch

from mnsf_ros.core.compute_device import (
    check_device,
    compute_device,
    layer_precision,
    limit_threads,
)
from mnsf_ros.errors import SettingsError
from mnsf_ros.settings import Settings

HAS_CUDA = torch.cuda.is_available()


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


def test_cuda_without_torch(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    check_device(settings_with(device="auto").compute)
    with pytest.raises(SettingsError, match="but PyTorch is not installed; use auto or cpu"):
        check_device(settings_with(device="cuda").compute)


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
