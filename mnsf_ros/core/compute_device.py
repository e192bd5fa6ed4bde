"""Where tensors live and how many threads may work."""

from __future__ import annotations

import torch

from mnsf_ros.errors import SettingsError
from mnsf_ros.settings import ComputeSettings


def compute_device(settings: ComputeSettings) -> torch.device:
    """The device that the settings ask for.

    Raises:
        SettingsError: If CUDA is asked for and torch finds none.
    """
    if settings.device == "cuda" and not torch.cuda.is_available():
        raise SettingsError(
            "compute.device: got 'cuda', but torch finds no usable CUDA device; use auto or cpu"
        )
    if settings.device == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    return torch.device(settings.device)


def limit_threads(settings: ComputeSettings) -> int:
    """Applies `compute.num_threads` to torch, for the calling thread too; 0 changes nothing.

    Returns:
        The number of threads, for the libraries that have to be told.
    """
    if settings.num_threads:
        torch.set_num_threads(settings.num_threads)
    return torch.get_num_threads()
