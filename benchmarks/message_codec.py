# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Time of decoding and encoding one sweep of 130,000 points, in several layouts.

Run as `python benchmarks/message_codec.py`. Needs NumPy only. Prints medians in milliseconds; the
targets are 5 ms for decode_xyz and 10 ms for encode_with_columns.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

# So that it also runs from a checkout that is not installed.
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from msg_utils.point_cloud2 import (
    EncodedCloud,
    FieldLayout,
    decode_points,
    decode_xyz,
    encode_with_columns,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

UINT8, UINT16, UINT32, FLOAT32, FLOAT64 = 2, 4, 6, 7, 8
XYZ = (("x", 0, FLOAT32), ("y", 4, FLOAT32), ("z", 8, FLOAT32))
XYZI = (*XYZ, ("intensity", 12, FLOAT32))
XYZIRT = (*XYZI, ("ring", 16, UINT16), ("time", 18, FLOAT32))
XYZIRADRT = (
    *XYZI,
    ("ring", 16, UINT16),
    ("azimuth", 18, FLOAT32),
    ("distance", 22, FLOAT32),
    ("return_type", 26, UINT8),
    ("time_stamp", 27, FLOAT64),
)
XYZ64 = (
    ("x", 0, FLOAT64),
    ("y", 8, FLOAT64),
    ("z", 16, FLOAT64),
    ("intensity", 24, UINT8),
    ("t", 25, UINT32),
)


@dataclass(frozen=True)
class Case:
    """One layout to measure."""

    name: str
    fields: tuple[tuple[str, int, int], ...]
    point_step: int
    is_bigendian: bool = False
    height: int = 1
    row_padding: int = 0


CASES = (
    Case("packed 16 B, xyz+intensity", XYZI, 16),
    Case("packed 22 B, xyz+intensity+ring+time", XYZIRT, 22),
    Case("padded 26 B, same fields", XYZIRT, 26),
    Case("padded 32 B, same fields", XYZIRT, 32),
    Case("XYZIRADRT 35 B, float64 at byte 27", XYZIRADRT, 35),
    Case("float64 xyz 29 B", XYZ64, 29),
    Case("big-endian 22 B", XYZIRT, 22, is_bigendian=True),
    Case("organized, 130 rows + 64 B each, 22 B", XYZIRT, 22, height=130, row_padding=64),
)


def make_cloud(case: Case, num_points: int, share_invalid: float) -> EncodedCloud:
    """Fill a cloud with random positions, of which a share is NaN in x."""
    fields = tuple(FieldLayout(name, offset, code, 1) for name, offset, code in case.fields)
    width = num_points // case.height
    row_step = width * case.point_step + case.row_padding
    data = np.zeros(case.height * row_step, np.uint8)
    cloud = EncodedCloud(
        case.height, width, fields, case.is_bigendian, case.point_step, row_step, data
    )
    points = decode_points(cloud)
    writeable: npt.NDArray[Any] = np.ndarray(
        points.shape, points.dtype, buffer=data, strides=points.strides
    )
    generator = np.random.default_rng(0)
    for name in ("x", "y", "z"):
        writeable[name] = generator.uniform(-80.0, 80.0, points.shape)
    writeable["x"][generator.random(points.shape) < share_invalid] = np.nan
    return cloud


def median_ms(function: Callable[[], object], repetitions: int) -> float:
    """Median wall time of calls, after one call to warm up."""
    function()
    times_ns = []
    for _ in range(repetitions):
        start_ns = time.perf_counter_ns()
        function()
        times_ns.append(time.perf_counter_ns() - start_ns)
    return statistics.median(times_ns) / 1e6


def main() -> None:
    """Measure all layouts and print one line each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--points", type=int, default=130_000)
    parser.add_argument("--repetitions", type=int, default=50)
    parser.add_argument("--invalid", type=float, default=0.1, help="share of NaN points, 0 to 1")
    options = parser.parse_args()
    print(f"{options.points} points, median of {options.repetitions} in ms, NumPy {np.__version__}")
    print(f"{'layout':<40}{'decode_points':>15}{'decode_xyz':>12}{'encode_with_columns':>21}")
    for case in CASES:
        cloud = make_cloud(case, options.points, options.invalid)
        num_points = cloud.height * cloud.width
        flow = {name: np.zeros(num_points, np.float32) for name in ("flow_x", "flow_y", "flow_z")}
        calls: tuple[Callable[[], object], ...] = (
            partial(decode_points, cloud),
            partial(decode_xyz, cloud),
            partial(encode_with_columns, cloud, flow),
        )
        views, xyz, encoded = (median_ms(call, options.repetitions) for call in calls)
        print(f"{case.name:<40}{views:>15.3f}{xyz:>12.2f}{encoded:>21.2f}")


if __name__ == "__main__":
    main()
