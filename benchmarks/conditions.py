# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the conditions of adverse worlds do to a method.

    python benchmarks/conditions.py [--seeds A B] [--alone] [--method NAME] [--workers N]
        [--cache DIR] [--document FILE]

Runs over random worlds, and over adverse worlds of the same seeds, see movers.py. A world has
several conditions: rows of one name the worlds that have it, among others. `--alone` runs over all
worlds with each condition alone, too, nine times as many. Constants are tuned without conditions.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from drives import kept_world
from frame import TARGET_HEADER, Table, Target, make_parser, publish
from movers import DURATION_S, add_world_options, in_processes, spread
from world_scores import WorldScore, world_score

from mnsf_ros.simulation.settings import CONDITIONS, SimulationSettings, scenario_of

_NONE: Final = "none"
_DRAWN: Final = "drawn"
_FALSE: Final = "false movers"
_FIGURES: Final = {
    "recall": "recall",
    "found": "movers found",
    "dynamic EPE": "EPE dynamic (m)",
    "static EPE": "EPE static (m)",
    "ego motion": "ego motion (m)",
}


def main() -> None:
    """Measures all conditions, prints the table, and writes it into a document."""
    parser = make_parser(__doc__)
    add_world_options(parser, (0, 16))
    parser.add_argument("--alone", action="store_true", help="each condition alone, too")
    parser.add_argument("--method", default="online", help="name")
    options = parser.parse_args()
    conditions = [_NONE, _DRAWN, *(CONDITIONS if options.alone else ())]
    tasks = [
        (seed, each, options.method, options.cache)
        for each in conditions
        for seed in range(*options.seeds)
    ]

    def measured() -> Iterator[Table]:
        scores = in_processes(_score, tasks, options.workers)
        number = len(tasks) // len(conditions)
        parts = [scores[begin : begin + number] for begin in range(0, len(scores), number)]
        yield from condition_tables(dict(zip(conditions, parts, strict=True)))

    publish("conditions", measured(), options.document)


def _score(seed: int, conditions: str, method: str, cache: Path) -> WorldScore:
    scenario = "random" if conditions == _NONE else "adverse"
    drawn = conditions if conditions in CONDITIONS else _DRAWN
    return world_score(kept_world(seed, DURATION_S, scenario, cache, drawn), scenario, method)


def condition_tables(scores: Mapping[str, Sequence[WorldScore]]) -> Iterator[Table]:
    """Figures of the worlds of each condition, and the targets of those with drawn ones."""
    drawn = scores[_DRAWN]
    rows = {_NONE: scores[_NONE], _DRAWN: drawn}
    for name in CONDITIONS:
        rows[f"with {name}"] = [one for one in drawn if name in _conditions(one.seed)]
        rows[f"{name} alone"] = scores.get(name, ())
    seeds = [one.seed for one in drawn]
    title = f"Adverse worlds, seeds {min(seeds)} to {max(seeds)}, `{drawn[0].method}`"
    header = ["", "worlds", "false movers a sweep", "own body moves", *_FIGURES.values()]
    yield Table(title, header, [[name, *_cells(own)] for name, own in rows.items() if own])
    recall, (_, worst) = spread(drawn, "recall")[0], spread(drawn, _FALSE)
    targets = [
        Target("drawn conditions: false movers a sweep, worst tenth", 0.1, worst),
        Target("drawn conditions: recall at .95 precision, median", 0.85, recall, is_minimum=True),
    ]
    yield Table("Targets, adverse worlds", TARGET_HEADER, [each.row() for each in targets])


def _cells(scores: Sequence[WorldScore]) -> list[str]:
    """Mean, median and worst tenth of false movers; of other figures mean or median."""
    false_movers = np.mean([one.figures[_FALSE] for one in scores])
    in_view = [one.figures["own body moves"] for one in scores]
    in_view = [share for share in in_view if not np.isnan(share)]
    return [
        str(len(scores)),
        "/".join(f"{each:.3f}" for each in (false_movers, *spread(scores, _FALSE))),
        f"{np.mean(in_view):.2f} of {len(in_view)}" if in_view else "",
        *(f"{spread(scores, figure)[0]:.3f}" for figure in _FIGURES),
    ]


def _conditions(seed: int) -> frozenset[str]:
    """Conditions of an adverse world."""
    return scenario_of(SimulationSettings(seed=seed, scenario="adverse")).conditions


if __name__ == "__main__":
    main()
