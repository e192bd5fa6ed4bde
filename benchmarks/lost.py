# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Whether an ego motion that is wrong says so, and how soon it is right again.

    python benchmarks/lost.py [--only NAME] [--quick] [--seeds A B] [--workers N] [--document FILE]

Disturbs drives in simulated streets and rooms, and cuts gaps into the real drives of the shared
data, if it is there; see lost_drives.py for the disturbances, and lost_scores.py for what counts as
wrong. `--quick`: one case of each disturbance and place. Constants are tuned on seeds 0 to 7.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final

import numpy as np
from frame import TARGET_HEADER, Table, Target, make_parser, publish
from lost_drives import DISTURBANCES, Case, cases, drives
from lost_scores import Score, score
from movers import in_processes

_HEADER: Final = (
    *("", "sweeps", "wrong and said", "WRONG AND UNSAID", "of these ego motion"),
    "said though right",
    "sweeps until right again",
)
_MAX_UNSAID: Final = 0.001
_MAX_MEDIAN_SWEEPS, _MAX_WORST_SWEEPS = 2.0, 5.0


@dataclass(frozen=True)
class Line:
    """The score of a case with one variant of its disturbance."""

    case: Case
    variant: str
    score: Score

    @property
    def kind(self) -> str:
        """Disturbance and variant."""
        return f"{self.case.disturbance}, {self.variant}"

    @property
    def cell(self) -> str:
        """The kind, and what it is tried on."""
        _, place, sensor, speed_m_s, _ = self.case
        on = ", ".join(each for each in (place, sensor) if each)
        return f"{self.kind}: {on}" + (f", {speed_m_s:g} m/s" if speed_m_s else "")


def main() -> None:
    """Measures all cases, prints their tables, and writes them into a document."""
    parser = make_parser(__doc__)
    parser.add_argument("--only", choices=tuple(DISTURBANCES), metavar="NAME", help="disturbance")
    parser.add_argument("--quick", action="store_true", help="one case of each kind")
    chosen = parser.add_argument("--seeds", nargs=2, type=int, metavar=("A", "B"), default=(20, 22))
    chosen.help = "cases from A to B - 1 (default: 20 22; 0 8: for tuning)"
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes")
    options = parser.parse_args()
    names = [options.only] if options.only else list(DISTURBANCES)
    chosen_cases = [each for name in names for each in cases(name, range(*options.seeds))]
    if options.quick:
        chosen_cases = _one_of_each_kind(chosen_cases)

    def measured() -> Iterator[Table]:
        found = in_processes(case_lines, [(case,) for case in chosen_cases], options.workers)
        yield from lost_tables([line for lines in found for line in lines])

    publish("lost", measured(), options.document)


def _one_of_each_kind(every: Sequence[Case]) -> list[Case]:
    """The first case of each disturbance in each place, each with another sensor and speed."""
    groups = [list(own) for _, own in groupby(every, lambda case: (case.disturbance, case.place))]
    return [own[(5 * number // 3 + 1) % len(own)] for number, own in enumerate(groups)]


def case_lines(case: Case) -> list[Line]:
    """The scores of all variants of a case."""
    return [Line(case, drive.variant, score(drive)) for drive in drives(case)]


def lost_tables(lines: Sequence[Line]) -> Iterator[Table]:
    """Figures of each disturbance and of each cell, and the targets."""
    seeds = sorted({line.case.seed for line in lines})
    title = f"Disturbed drives, seeds {seeds[0]} to {seeds[-1]}"
    yield Table(f"{title}: cells", _HEADER, _rows(lines, "cell"), is_detail=True)
    yield Table(title, _HEADER, [*_rows(lines, "kind"), ["all", *_figures(lines)]])
    median, worst = _until_right(lines)
    targets = [
        Target("wrong and unsaid, of all sweeps", _MAX_UNSAID, _share(lines, "wrong_unsaid")),
        Target("the same, if the ego motion is wrong", _MAX_UNSAID, _share(lines, "ego_unsaid")),
        Target("sweeps until right again, median", _MAX_MEDIAN_SWEEPS, median),
        Target("sweeps until right again, worst tenth", _MAX_WORST_SWEEPS, worst),
    ]
    yield Table("Targets, disturbed drives", TARGET_HEADER, [each.row() for each in targets])


def _rows(lines: Sequence[Line], name: str) -> list[list[str]]:
    """A row for each kind, or for each cell."""
    names = dict.fromkeys(getattr(line, name) for line in lines)
    own = {each: [line for line in lines if getattr(line, name) == each] for each in names}
    return [[each, *_figures(its)] for each, its in own.items()]


def _figures(lines: Sequence[Line]) -> list[str]:
    """Cells of all columns of `_HEADER` but the first."""
    names = ("sweeps", "wrong_said", "wrong_unsaid", "ego_unsaid", "right_said")
    counts = [sum(getattr(line.score, name) for line in lines) for name in names]
    median, worst = _until_right(lines)
    is_known = not np.isnan(median)
    return [*map(str, counts), f"{median:g}/{worst:g}" if is_known else ""]


def _share(lines: Sequence[Line], name: str) -> float:
    """Share of the sweeps that a number of the scores counts."""
    counted = sum(line.score.sweeps for line in lines)
    return sum(getattr(line.score, name) for line in lines) / max(counted, 1)


def _until_right(lines: Sequence[Line]) -> tuple[float, float]:
    """Median and worst tenth over drives; NaN if none of them has an end of its disturbance."""
    numbers = np.array([line.score.sweeps_until_right for line in lines])
    numbers = numbers[~np.isnan(numbers)]
    if len(numbers) == 0:
        return float("nan"), float("nan")
    # Between a number and infinity there is nothing to interpolate.
    median, worst = np.quantile(numbers, (0.5, 0.9), method="higher")
    return float(median), float(worst)


if __name__ == "__main__":
    main()
