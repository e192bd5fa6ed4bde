# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Memory and time of `mnsf evaluate` on a recording of any size, which is written first.

    python benchmarks/large_recording.py [--gigabytes 50] [--folder DIR]

The recording has sweeps of 128 beams, 4.2 MB each, of a robot that stands still; ten of them are
repeated with new stamps. It is evaluated with the row `zero`, that is read, checked, decoded,
cropped and scored, in a process whose memory is looked at all the time.
"""

from __future__ import annotations

import argparse
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from rosbags.typesys import Stores, get_typestore

from mnsf_ros.recording.bag_messages import cloud_message
from mnsf_ros.recording.bag_topics import CLOUD_TYPE, POINTS_TOPIC
from mnsf_ros.recording.bag_writer import BagWriter
from msg_utils.point_cloud2 import encode_columns

_NUM_BEAMS: Final = 128
_NUM_COLUMNS: Final = 2048
_NUM_SWEEPS: Final = 10
_FIRST_NS: Final = 1_700_000_000 * 10**9
_STEP_NS: Final = 100_000_000
# Of a serialized cloud: after the four bytes that tell the encoding.
_STAMP_OFFSET: Final = 4
_LOOK_S: Final = 0.5
_NUM_PARTS: Final = 5


def main() -> None:
    """Writes, evaluates, prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=_Raw)
    parser.add_argument("--gigabytes", type=float, default=50.0)
    parser.add_argument("--folder", type=Path, help="where there is room (default: temporary)")
    options = parser.parse_args()
    console = Console(width=100)
    with tempfile.TemporaryDirectory(dir=options.folder) as temporary:
        folder = Path(temporary)
        num_sweeps = write_recording(folder / "large", options.gigabytes * 1e9)
        used_mb, wall_s = evaluated(folder)
        size_gb = sum(file.stat().st_size for file in (folder / "large").iterdir()) / 1e9
        rows = (folder / "results" / "rows.jsonl").read_text().count("\n")
    table = Table(title=f"{size_gb:.1f} GB, {num_sweeps:,} sweeps, {rows:,} rows, {wall_s:.0f} s")
    table.add_column("part of the time")
    table.add_column("memory at most (MB)", justify="right")
    for number, part in enumerate(np.array_split(np.array(used_mb), _NUM_PARTS), start=1):
        table.add_row(f"{number} of {_NUM_PARTS}", f"{part.max():.0f}")
    console.print(table)


def write_recording(path: Path, num_bytes: float) -> int:
    """Writes sweeps until the recording has so many bytes; returns their number."""
    sweeps = [_serialized(np.random.default_rng(number)) for number in range(_NUM_SWEEPS)]
    num_sweeps = max(3, round(num_bytes / len(sweeps[0])))
    with BagWriter(path) as writer:
        for number in track(range(num_sweeps), "writing"):
            raw, stamp_ns = sweeps[number % _NUM_SWEEPS], _FIRST_NS + number * _STEP_NS
            struct.pack_into("<iI", raw, _STAMP_OFFSET, *divmod(stamp_ns, 10**9))
            writer.write_raw(POINTS_TOPIC, CLOUD_TYPE, stamp_ns, raw)
    return num_sweeps


def _serialized(rng: np.random.Generator) -> bytearray:
    """A cloud of walls all around, with the noise of a lidar."""
    columns, beams = np.meshgrid(np.arange(_NUM_COLUMNS), np.arange(_NUM_BEAMS))
    azimuth = columns.ravel() * 2 * np.pi / _NUM_COLUMNS
    elevation = np.radians(beams.ravel() * 40 / _NUM_BEAMS - 25)
    range_m = 12 + 6 * np.sin(5 * azimuth) + rng.normal(0, 0.02, len(azimuth))
    xyz = {
        "x": range_m * np.cos(azimuth),
        "y": range_m * np.sin(azimuth),
        "z": np.maximum(range_m * np.tan(elevation), -1.8),
    }
    data = {name: column.astype(np.float32) for name, column in xyz.items()}
    data["intensity"] = rng.uniform(0, 255, len(azimuth)).astype(np.float32)
    encoded = encode_columns(data, _NUM_BEAMS, _NUM_COLUMNS)
    message = cloud_message(encoded, _FIRST_NS, "lidar", is_dense=True)
    return bytearray(get_typestore(Stores.ROS2_JAZZY).serialize_cdr(message, CLOUD_TYPE))


def evaluated(folder: Path) -> tuple[list[float], float]:
    """Evaluates; returns the memory of the process again and again in MB, and seconds."""
    command = [Path(sys.executable).with_name("mnsf"), "evaluate", folder / "large"]
    command += ["--methods", "zero", "--num-points", "2048", "--pictures", "0"]
    start, used_mb = time.monotonic(), []
    with subprocess.Popen([*command, "--out", folder / "results"]) as process:
        status = Path(f"/proc/{process.pid}/status")
        while process.poll() is None:
            used_mb += [
                int(line.split()[1]) / 1024
                for line in status.read_text().splitlines()
                if line.startswith("VmRSS")
            ]
            time.sleep(_LOOK_S)
    if process.returncode:
        raise SystemExit(f"mnsf evaluate ended with {process.returncode}")
    return used_mb, time.monotonic() - start


class _Raw(argparse.RawDescriptionHelpFormatter):
    pass


if __name__ == "__main__":
    main()
