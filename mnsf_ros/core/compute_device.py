# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Device, precision and threads of networks.

PyTorch is imported only when it is needed: that takes seconds, and `online` does without it; NumPy
only after its threads are chosen.
"""

import os
from collections.abc import Iterator, Mapping, MutableMapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from mnsf_ros.errors import SettingsError
from mnsf_ros.settings import ComputeSettings

if TYPE_CHECKING:
    import torch
    from numpy.typing import NDArray

# Instructions of x86 processors that multiply bfloat16, as `torch.cpu` names them.
_CPU_BFLOAT16: Final = ("amx_bf16", "avx512_bf16")


def compute_device(settings: ComputeSettings) -> "torch.device":
    """Returns the device of the settings.

    Raises:
        SettingsError: If CUDA is asked for and torch finds none.
    """
    import torch

    if settings.device == "cuda" and not torch.cuda.is_available():
        raise SettingsError(
            "compute.device: got 'cuda', but torch finds no usable CUDA device; use auto or cpu"
        )
    if settings.device == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    return torch.device(settings.device)


def check_device(settings: ComputeSettings) -> None:
    """Checks that the device is there, if the settings ask for a certain one.

    Raises:
        SettingsError: If CUDA is asked for and torch finds none, or is not installed.
    """
    if settings.device != "cuda":
        return
    try:
        compute_device(settings)
    except ModuleNotFoundError as error:
        raise SettingsError(
            "compute.device: got 'cuda', but PyTorch is not installed; use auto or cpu"
        ) from error


def layer_precision(settings: ComputeSettings) -> "torch.dtype":
    """Returns the precision of products between hidden layers.

    It is float32 where the device does not compute in bfloat16 itself: there it would be slower.
    """
    import torch

    is_wanted = settings.precision == "bfloat16"
    return torch.bfloat16 if is_wanted and _computes_in_bfloat16(settings) else torch.float32


def _computes_in_bfloat16(settings: ComputeSettings) -> bool:
    import torch

    if compute_device(settings).type == "cuda":
        return bool(torch.cuda.is_bf16_supported())
    # What PyTorch before 2.10 cannot tell counts as missing.
    capabilities: Mapping[str, Any] = getattr(torch.cpu, "get_capabilities", dict)()
    return any(capabilities.get(name) for name in _CPU_BFLOAT16)


def on_device(array: "NDArray[Any]", device: "torch.device") -> "torch.Tensor":
    """Returns an array on a device; on the CPU it shares the memory if that can be written."""
    import numpy as np
    import torch

    return torch.from_numpy(np.require(array, requirements="W")).to(device)


def limit_threads(settings: ComputeSettings) -> None:
    """Applies `compute.num_threads` to torch, for the calling thread too; 0 changes nothing."""
    import torch

    if settings.num_threads:
        torch.set_num_threads(settings.num_threads)


@contextmanager
def one_thread() -> Iterator[None]:
    """Runs torch in one thread meanwhile: for a few hundred rows others only cost."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def node_threads() -> int:
    """Default number of threads of a live node: one core is left to the executor."""
    return max(1, (os.cpu_count() or 1) - 1)


def let_threads_sleep(environment: MutableMapping[str, str] = os.environ) -> None:
    """Lets no thread of PyTorch and NumPy spin while it waits, unless the user has chosen.

    Those of OpenMP that spin are 50 times slower where other programs want the cores, and burn the
    core that the ROS executor needs. For a product of (N, 3) points and a matrix, OpenBLAS wakes a
    thread for each core: `mnsf simulate` takes twice the time with them. The libraries read this
    when they are imported: programs call it before.
    """
    environment.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    environment.setdefault("OPENBLAS_NUM_THREADS", "1")
