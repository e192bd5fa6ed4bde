# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The live node over DDS, with `online` and `mnsf`: latency, and dropped sweeps.

    python benchmarks/live.py [--quick] [--document FILE]

Latency is the time from publication of sweep t+1 to arrival of the flow of t. The machine should
have nothing else to do. Use a ROS_DOMAIN_ID of its own.
"""

import os
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from drives import real_sweeps, simulated_drive, to_and_fro
from frame import TARGET_HEADER, Table, Target, make_parser, publish
from live_node import busy_cores, live_node, serialized

from mnsf_ros.sweeps.sweep import Sweep

# Recorded sweeps are played to and fro; streets have to be simulated as long as they are played.
_RECORDED_S: Final = 60
_STREET_S: Final = 20
_QUICK_S: Final = 10
_WARM_UP_S: Final = 3
_KITTI, _STREET = "64 beams, KITTI 0005", "64 beams, street"
_DENSE: Final = "128 beams, street"
_MNSF: Final = "`mnsf`, KITTI 0005"
_MNSF_LOADED: Final = _MNSF + ", half of the cores busy"
_MNSF_FILE: Final = Path(__file__).parents[1] / "config" / "mnsf.yaml"
# Ratios hold on any machine, times on quiet ones with two cores or more.
_MAX_LATENCY_RATIO: Final = 1.3
_MAX_P95_MS: Final = {_KITTI: 100, _STREET: 100, _DENSE: 200}
_MAX_MEMORY_MB: Final = {_STREET: 250, _MNSF: 700, _MNSF_LOADED: 700}
_MAX_START_S: Final = 1.0


@dataclass(frozen=True)
class Played:
    """Fate of the sweeps of one run after the first seconds.

    Attributes:
        num_points: Mean number of points of a sweep.
        latencies_ms: Latency of each flow.
        dropped: Number of sweeps without flow.
        estimate_ms: Median time of an estimate, by the node's diagnostics.
        cpu_ms: CPU time of the process for each sweep.
        memory_mb: Largest memory of the process.
        start_s: Time from the start of the process until it was ready.
    """

    num_points: float
    latencies_ms: list[float]
    dropped: int
    estimate_ms: float
    cpu_ms: float
    memory_mb: float
    start_s: float

    def percentile_ms(self, percentile: float) -> float:
        """Percentile of the latencies; NaN if there was no flow."""
        return float(np.percentile(self.latencies_ms, percentile)) if self.latencies_ms else np.nan


def main() -> None:
    """Plays every run, prints the tables, and writes them into a document."""
    parser = make_parser(__doc__)
    parser.add_argument("--quick", action="store_true", help=f"{_QUICK_S} s of each run")
    options = parser.parse_args()
    durations_s = (_QUICK_S, _QUICK_S) if options.quick else (_RECORDED_S, _STREET_S)
    publish("live", tables(*durations_s), options.document)


def tables(recorded_s: int, street_s: int) -> Iterator[Table]:
    """One row for each run; then the targets."""
    played = dict(_runs(recorded_s, street_s))
    rows = [
        [
            name,
            f"{run.num_points:,.0f}",
            *(f"{run.percentile_ms(percentile):.0f}" for percentile in (50, 95)),
            f"{run.dropped} of {run.dropped + len(run.latencies_ms)}",
            f"{run.cpu_ms:.0f}",
            f"{run.memory_mb:.0f}",
        ]
        for name, run in played.items()
    ]
    header = ["10 Hz", "points", "latency p50 (ms)", "p95 (ms)", "dropped", "CPU (ms)", "MB"]
    title = (
        f"{recorded_s} s of recorded sweeps, {street_s} s of streets, first {_WARM_UP_S} s apart"
    )
    yield Table(title, header, rows)
    street = played[_STREET]
    targets = [
        *(
            Target(f"p95 (ms): {name}", limit_ms, played[name].percentile_ms(95))
            for name, limit_ms in _MAX_P95_MS.items()
            if name in played
        ),
        *(Target(f"dropped: {name}", 0, run.dropped) for name, run in played.items()),
        Target(
            "latency p50 over the time of an estimate",
            _MAX_LATENCY_RATIO,
            street.percentile_ms(50) / street.estimate_ms,
        ),
        Target("start until ready (s)", _MAX_START_S, street.start_s),
        *(
            Target(f"memory (MB): {name}", limit_mb, played[name].memory_mb)
            for name, limit_mb in _MAX_MEMORY_MB.items()
            if name in played
        ),
    ]
    yield Table("Targets", TARGET_HEADER, [each.row() for each in targets], is_detail=True)


def _runs(recorded_s: int, street_s: int) -> Iterator[tuple[str, Played]]:
    if kitti := to_and_fro(item.sweep for item in real_sweeps("kitti_0005")[:24]):
        yield _KITTI, _play(kitti, recorded_s)
        yield _MNSF, _play(kitti, recorded_s, file=_MNSF_FILE)
        with busy_cores((os.cpu_count() or 1) // 2):
            yield _MNSF_LOADED, _play(kitti, recorded_s, file=_MNSF_FILE)
    street = [item.sweep for item in simulated_drive(0, 10 * street_s)]
    yield _STREET, _play(street, street_s)
    fast = simulated_drive(0, 20 * street_s, rate_hz=20)
    yield _STREET + ", 20 Hz", _play((item.sweep for item in fast), street_s, rate_hz=20)
    dense = simulated_drive(0, 10 * street_s, num_beams=128, num_columns=1760)
    yield _DENSE, _play((item.sweep for item in dense), street_s)


def _play(
    sweeps: Iterable[Sweep], duration_s: int, rate_hz: int = 10, file: Path | None = None
) -> Played:
    """Publishes sweeps to a node with a parameter file, from the first to the last and again."""
    clouds, counts = zip(*((serialized(sweep), len(sweep)) for sweep in sweeps), strict=True)
    with live_node(file=file) as node:
        start_s, start_cpu_s = time.monotonic(), node.cpu_s
        for index in range(duration_s * rate_hz):
            node.spin_for(start_s + index / rate_hz - time.monotonic())
            node.publish(clouds[index % len(clouds)], 10**9 // rate_hz)
        node.spin_for(3.0)
        cpu_ms = 1e3 * (node.cpu_s - start_cpu_s) / (duration_s * rate_hz)
        estimate_ms = float(node.values.get("estimate median [ms]", np.nan))
        fates = _fates(node.published_s, node.arrived_s)
        own = (cpu_ms, node.memory_mb("VmHWM"), node.start_s)
        return Played(float(np.mean(counts)), *fates, estimate_ms, *own)


def _fates(published_s: dict[int, float], arrived_s: dict[int, float]) -> tuple[list[float], int]:
    """Latencies of the flows that arrived, and the number of those that did not."""
    first_ns = min(published_s) + _WARM_UP_S * 10**9
    # The first and the last sweep have no neighbours on both sides.
    wanted = [pair for pair in list(pairwise(published_s))[1:] if pair[0] >= first_ns]
    latencies_ms = [
        (arrived_s[stamp] - published_s[following]) * 1e3
        for stamp, following in wanted
        if stamp in arrived_s
    ]
    return latencies_ms, len(wanted) - len(latencies_ms)


if __name__ == "__main__":
    main()
