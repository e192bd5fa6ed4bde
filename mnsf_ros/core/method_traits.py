# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What a method needs; apart from its interface, since it needs no library."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class MethodTraits:
    """Properties of a method with its settings.

    Attributes:
        num_sweeps: Sweeps that the method looks at: 2 are current and next, 3 the previous, too.
        carries_state: Whether an estimate depends on the ones before it. Such a method must get
            its triplets in order and without gaps, and an interrupted run starts again.
        max_gap_s: Longest time from the last triplet to the next over which its state holds. After
            a longer one the stream goes on with a renewed estimator.
        needs_poses: Whether `triplet.next_from_current` must be known.
        is_reference: Whether it is a row to compare with, such as zero flow, and no rival.
        is_external: Whether it is another program or its files. Such a method is not warmed up,
            and does not estimate again just for a picture.
        is_timed: False if its run time says nothing, as for predictions read from files.
    """

    num_sweeps: int = 2
    carries_state: bool = False
    max_gap_s: float = math.inf
    needs_poses: bool = False
    is_reference: bool = False
    is_external: bool = False
    is_timed: bool = True
