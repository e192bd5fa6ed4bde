# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""CPU of an estimate of `online` and of `mnsf`, and of the node, beside KISS-ICP, in one run.

    python benchmarks/cost.py [--commit COMMIT] [--document FILE]

KISS-ICP registers the same sweeps on one thread, in turns (`pip install '.[benchmark]'`). Sweeps
are those of KITTI 0005 if the shared data is there (see drives.py), and of a simulated street. Use
a ROS_DOMAIN_ID of its own. With a commit it compares only estimates with those of that commit, in
turns.
"""

import importlib.util
import os
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

# Before libraries with threads of their own are loaded.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from drives import TrueSweep, real_sweeps, simulated_sweeps, to_and_fro, triplet_at
from estimates_ms import WARM_UP
from frame import TARGET_HEADER, Table, Target, make_parser, publish
from live_node import LiveNode, live_node, serialized

from mnsf_ros.methods import make_method
from mnsf_ros.node.environment import keep_memory
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import Sweep

_OWN: Final = Path(__file__).resolve().parents[1]
# Runs of each of two commits.
_NUM_TURNS: Final = 3
_NUM_SWEEPS: Final = 24
# Method to limit. On the few planes of a street a registration is cheap.
_ON_STREET: Final = {"online": 0.8, "mnsf": 1.0}
_ON_KITTI: Final = {"online": 0.5, "mnsf": 1.0}
_MAX_NODE: Final = 0.75
# Sweeps that the node gets, at 10 Hz.
_NUM_PLAYED: Final = 200
_INTERVAL_S: Final = 0.1


def main() -> None:
    """Measures, prints the table, and writes it into a document."""
    parser = make_parser(__doc__)
    parser.add_argument("--commit", help="compare estimates with those of this commit")
    options = parser.parse_args()
    if options.commit:
        publish("cost-over-commit", [_over_commit(options.commit)], options.document)
    else:
        publish("cost", tables(), options.document)


def tables() -> Iterator[Table]:
    """One row for each target."""
    keep_memory()  # as the node does
    places, targets = _places(), []
    for place, sweeps in places.items():
        targets += _targets(place, sweeps, _ON_STREET if place == "street" else _ON_KITTI)
    *_, last = places.values()
    targets.append(_node_target([item.sweep for item in last]))
    title = (
        f"CPU of an estimate over KISS-ICP's, one thread, {len(places['street'][0].sweep):,} points"
    )
    yield Table(title, TARGET_HEADER, [target.row() for target in targets])


def _places() -> dict[str, list[TrueSweep]]:
    """Sweeps by the name of their place."""
    kitti = [
        replace(item, sweep=replace(item.sweep, times_s=None))
        for item in real_sweeps("kitti_0005")[:_NUM_SWEEPS]
    ]
    return {"street": simulated_sweeps(0, _NUM_SWEEPS)} | ({"KITTI 0005": kitti} if kitti else {})


def _over_commit(commit: str) -> Table:
    """CPU of an estimate by each method over that of another commit."""
    header, rows = ["", f"over {commit}", "ms", f"ms at {commit}"], []
    with TemporaryDirectory() as folder:
        other = Path(folder) / "checkout"
        subprocess.run(["git", "-C", _OWN, "worktree", "add", "-q", other, commit], check=True)
        try:
            for place, sweeps in _places().items():
                file = Path(folder) / "sweeps.npz"
                np.savez(file, **{str(row): each.sweep.xyz for row, each in enumerate(sweeps)})
                for method in ("online", "mnsf"):
                    own_ms, other_ms = _both_ms(method, file, other)
                    ratio = f"{own_ms / other_ms:.2f}"
                    rows.append([f"`{method}`, {place}", ratio, f"{own_ms:.0f}", f"{other_ms:.0f}"])
        finally:
            subprocess.run(["git", "-C", _OWN, "worktree", "remove", "--force", other], check=True)
    return Table("CPU of an estimate, one thread", header, rows)


def _both_ms(method: str, file: Path, other: Path) -> list[float]:
    """CPU of an estimate by this program, and by that of another checkout, in turns."""
    script = Path(__file__).with_name("estimates_ms.py")
    found: dict[Path, list[float]] = {_OWN: [], other: []}
    for _ in range(_NUM_TURNS):
        for checkout, times_ms in found.items():
            done = subprocess.run(
                [sys.executable, script, method, file, checkout],
                env=os.environ | {"PYTHONPATH": str(checkout)},
                stdout=subprocess.PIPE,
                check=True,
            )
            times_ms.append(float(done.stdout))
    return [float(np.median(times_ms)) for times_ms in found.values()]


def _targets(
    place: str, sweeps: Sequence[TrueSweep], limits: Mapping[str, float]
) -> Iterator[Target]:
    """CPU of one estimate of each method over that of one registration, in turns."""
    kiss, settings = _kiss_icp(), preset("online").changed({"compute.num_threads": 1})
    estimators = {method: make_method(method, settings) for method in limits}
    times_ms = defaultdict(list)
    for index in range(1, len(sweeps) - 1):
        triplet = triplet_at(sweeps, index)
        for method, estimator in estimators.items():
            start_s = time.process_time()
            estimator.estimate(triplet)
            times_ms[method].append(1e3 * (time.process_time() - start_s))
        times_ms["kiss"].append(_kiss_ms(kiss, triplet.next))
    median_ms = {name: float(np.median(own[WARM_UP:])) for name, own in times_ms.items()}
    for method, limit in limits.items():
        yield _ratio_target(f"`{method}`, {place}", median_ms[method], median_ms["kiss"], limit)


def _node_target(sweeps: Sequence[Sweep]) -> Target:
    """CPU of the node's process for a sweep, with its flow subscribed to, over a registration."""
    kiss = _kiss_icp()
    kiss_ms = float(np.median([_kiss_ms(kiss, sweep) for sweep in sweeps][WARM_UP:]))
    clouds = [serialized(sweep) for sweep in to_and_fro(sweeps)]
    with live_node() as node:
        _play(node, clouds, len(clouds))
        begin_s, num_before = node.cpu_s, len(node.arrived_s)
        _play(node, clouds, _NUM_PLAYED)
        own_ms = 1e3 * (node.cpu_s - begin_s) / (len(node.arrived_s) - num_before)
    return _ratio_target("the node a sweep, `~/flow`", own_ms, kiss_ms, _MAX_NODE)


def _play(node: LiveNode, clouds: Sequence[bytearray], number: int) -> None:
    for index in range(number):
        node.publish(clouds[index % len(clouds)])
        node.spin_for(_INTERVAL_S)


def _ratio_target(name: str, own_ms: float, kiss_ms: float, limit: float) -> Target:
    ratio = own_ms / kiss_ms
    text = f"{own_ms:.0f} ms" if np.isnan(ratio) else f"{ratio:.2f} ({own_ms:.0f} ms)"
    return Target(name, limit, ratio, text=text)


def _kiss_icp() -> Any:  # noqa: ANN401 - of a library without types
    """A KISS-ICP, or None if it is not installed."""
    if importlib.util.find_spec("kiss_icp") is None:
        return None
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.max_range, config.data.min_range, config.data.deskew = 100.0, 1.0, False
    config.registration.max_num_threads = 1
    config.mapping.voxel_size = 1.0
    return KissICP(config)


def _kiss_ms(kiss: Any, sweep: Sweep) -> float:  # noqa: ANN401
    """CPU time of the registration of a sweep; NaN without KISS-ICP."""
    if kiss is None:
        return float("nan")
    xyz = sweep.xyz.astype(np.float64)
    start_s = time.process_time()
    kiss.register_frame(xyz, np.zeros(0))
    return 1e3 * (time.process_time() - start_s)


if __name__ == "__main__":
    main()
