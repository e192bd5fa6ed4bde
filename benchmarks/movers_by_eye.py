# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the online method calls dynamic on real drives whose movers were written down by eye.

    python benchmarks/movers_by_eye.py [--document FILE]

Labels cover a sixth of KITTI 0005 and nothing of Apollo. So the places of all that moves around the
vehicle were read from sweeps drawn over each other (movers_by_eye.json). What is called dynamic
elsewhere is a false mover, and its confidence should be low. Runs consecutive sweeps, and each
sweep with the next one only. Needs the shared data, see online_recordings.py.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from marked_section import add_document_option, replace_section
from numpy.typing import NDArray
from online_recordings import TrueSweep, real_sweeps
from rich.console import Console

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.geometry.rigid_motion import transformed
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.report.text_table import TextTable
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S, SweepTriplet

DRIVES: Final = {"apollo_arz034": "Apollo", "kitti_0005": "KITTI 0005"}
_PLACES: Final = Path(__file__).with_suffix(".json")
# Points this close are of the vehicle itself.
_MIN_RANGE_M: Final = 2.2
_FAST_M_S: Final = 10.0


@dataclass(frozen=True)
class Mover:
    """Something that moves.

    Attributes:
        first: The first sweep that shows it.
        half_m: (2,) half of its extent along x and y of the world, with a margin.
        xy_m: (S, 2) its places in the world, sweep by sweep.
    """

    first: int
    half_m: NDArray[np.float64]
    xy_m: NDArray[np.float64]

    def holds(self, places: NDArray[np.float64], number: int) -> NDArray[np.bool_]:
        """Returns (K,) which places (K, 2) of a sweep are on it."""
        apart = np.abs(places - self.xy_m[number - self.first])
        is_on_it: NDArray[np.bool_] = (apart <= self.half_m).all(axis=1)
        return is_on_it


@dataclass(frozen=True)
class Seen:
    """What was called dynamic in one sweep.

    Attributes:
        num_movers: Movers in view.
        num_found: Those with an object that is called dynamic.
        false: (F, 2) m/s and confidence of the other objects that are called so.
    """

    num_movers: int
    num_found: int
    false: NDArray[np.float64]


class Eyes:
    """What moves on a drive, by eye.

    Attributes:
        movers: All that does.
    """

    def __init__(self, drive: str) -> None:
        content: dict[str, list[dict[str, Any]]] = json.loads(_PLACES.read_text())[drive]
        self.movers = [
            Mover(each["first"], np.array(each["half_m"]), np.array(each["xy_m"]))
            for each in content["movers"]
        ]
        self._unclear = content["unclear"]

    def seen(self, number: int, truth: TrueSweep, estimate: FlowEstimate) -> Seen:
        """Compares what is called dynamic in a sweep with what moves there."""
        decision, sweep = estimate.reason_of.decision, estimate.reason_of.current
        movers = decision.fitted.objects.only(decision.is_moving)
        places = transformed(movers.centers, truth.pose)[:, :2].astype(np.float64)
        counted = np.hypot(*movers.centers[:, :2].T) > _MIN_RANGE_M
        for each in self._unclear:
            counted &= np.hypot(*(places - each["xy_m"]).T) > each["radius_m"]
        in_view = [each for each in self.movers if 0 <= number - each.first < len(each.xy_m)]
        are_on = np.array([each.holds(places, number) for each in in_view]) & counted
        rows = np.flatnonzero(counted & ~are_on.any(axis=0))
        speeds = np.linalg.norm(decision.moving.motions[decision.is_moving], axis=1)
        confidence, owners = estimate.over_ground.confidence, sweep.objects()
        sure = [confidence[owners == movers.numbers[row]].mean() for row in rows]
        false = np.stack([speeds[rows] / USUAL_INTERVAL_S, np.array(sure)], axis=1)
        return Seen(len(in_view), int(are_on.any(axis=1).sum()), false)


def seen_on(drive: str, *, are_pairs: bool) -> Iterator[Seen]:
    """Runs the online preset over a drive, sweep by sweep or each with the next one only."""
    sweeps, eyes = real_sweeps(drive), Eyes(drive)
    estimator = make_method("online", preset("online"))
    for number in range(0 if are_pairs else 1, len(sweeps) - 1):
        pair = [item.sweep for item in sweeps[number : number + 2]]
        previous = None if are_pairs else sweeps[number - 1].sweep
        if are_pairs:
            estimator = make_method("online", preset("online"))
        estimate = estimator.estimate(SweepTriplet(previous, *pair))
        yield eyes.seen(number, sweeps[number], estimate)


def table() -> TextTable:
    """One row for each drive and way to run it."""
    rows = []
    for drive, name in DRIVES.items():
        for are_pairs in (False, True):
            seen = list(seen_on(drive, are_pairs=are_pairs))
            if not seen:
                continue
            found = sum(each.num_found for each in seen)
            known = sum(each.num_movers for each in seen)
            speeds, sure = np.concatenate([each.false for each in seen]).T
            are_fast = speeds >= _FAST_M_S
            way = "two sweeps" if are_pairs else "consecutive"
            cells = f"{found} of {known}", _listed(sure[are_fast]), _listed(sure[~are_fast])
            rows.append([f"{name}, {way} ({len(seen)})", *cells])
    header = ["drive (sweeps)", "found", "false, 10 m/s and faster", "false, slower"]
    return TextTable(header, rows, "Movers by eye; false movers with their confidence")


def _listed(confidences: NDArray[np.float64]) -> str:
    values = ", ".join(f"{each:.2f}" for each in np.sort(confidences))
    return f"{len(confidences)}: {values}" if values else "none"


def main() -> None:
    """Prints the table."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    add_document_option(parser)
    options = parser.parse_args()
    found = table()
    Console(width=120).print(found)
    if options.document:
        replace_section(options.document, "movers by eye", found.markdown())


if __name__ == "__main__":
    main()
