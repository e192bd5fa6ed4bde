# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""g_invert: the flow back to the previous sweep, turned into a flow to the next one."""

from __future__ import annotations

import torch


def invert_motion(backward_flow: torch.Tensor, interval_ratio: float = 1.0) -> torch.Tensor:
    """Inverts motion under the constant model of the paper (section 3): f' = -b.

    Args:
        backward_flow: (N, 3) metres, from t to t-1.
        interval_ratio: Time from t to t+1 over time from t-1 to t. With equal intervals, as in
            the paper, this is 1; a point of constant velocity moves that much farther.

    Returns:
        (N, 3) metres, from t to t+1.
    """
    return -interval_ratio * backward_flow
