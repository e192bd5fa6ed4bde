# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Where tensors live, and how many threads work on them."""

from __future__ import annotations

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


def test_device_that_is_asked_for(device):
    assert compute_device(settings_with(device=device.type).compute) == device


def test_auto_takes_cuda_where_there_is_one():
    assert compute_device(settings_with(device="auto").compute).type == (
        "cuda" if HAS_CUDA else "cpu"
    )


@pytest.mark.skipif(HAS_CUDA, reason="there is CUDA")
def test_cuda_where_there_is_none():
    settings = settings_with(device="cuda")
    text = "^compute.device: got 'cuda', but torch finds no usable CUDA device; use auto or cpu$"
    for ask in (compute_device, check_device):
        with pytest.raises(SettingsError, match=text):
            ask(settings.compute)


@pytest.mark.parametrize(
    ("capabilities", "expected"),
    [
        ({"amx_bf16": True, "avx512_bf16": True}, torch.bfloat16),
        ({"amx_bf16": False, "avx512_bf16": True}, torch.bfloat16),
        ({"amx_bf16": False, "avx512_f": True}, torch.float32),
        ({}, torch.float32),
    ],
)
def test_bfloat16_only_where_the_processor_computes_in_it(monkeypatch, capabilities, expected):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: capabilities, raising=False)
    asked = settings_with(device="cpu", precision="bfloat16")
    assert layer_precision(asked.compute) is expected
    assert layer_precision(settings_with(device="cpu").compute) is torch.float32


def test_float32_where_pytorch_cannot_tell(monkeypatch):
    monkeypatch.delattr(torch.cpu, "get_capabilities", raising=False)
    asked = settings_with(device="cpu", precision="bfloat16")
    assert layer_precision(asked.compute) is torch.float32


@pytest.fixture
def threads():
    """Restores the number of threads of torch."""
    before = torch.get_num_threads()
    yield before
    torch.set_num_threads(before)


def test_number_of_threads(threads):
    limit_threads(settings_with(num_threads=threads + 1).compute)
    assert torch.get_num_threads() == threads + 1
    limit_threads(settings_with(num_threads=0).compute)
    assert torch.get_num_threads() == threads + 1
