# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What each rule of `online` buys: random worlds without one at a time.

    python benchmarks/leave_one_out.py [--seeds A B] [--workers N] [--cache DIR] [--document FILE]

Means over worlds, see movers.py, which makes them. A rule that buys nothing on worlds that it was
not made for should go.
"""

from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np
import pandas as pd
import world_scores
from drives import kept_world
from frame import Table, make_parser, publish
from movers import DURATION_S, FIGURES, add_world_options, in_processes
from world_scores import world_score

from mnsf_ros.online import attachments, gate, motions, object_flow, target, turning
from mnsf_ros.presets import preset
from mnsf_ros.sweeps import range_view
from mnsf_ros.sweeps.ground_surface import GroundSurface

_NAMES: Final = ("recall", "found", "pedestrians", "false movers", "dynamic EPE")
_FIGURES: Final = {name: FIGURES[name][0] for name in (*_NAMES, "dynamic EPE, two sweeps")}


def _without_term(term: int) -> tuple[Any, str, Any]:
    weights = np.array(gate._WEIGHTS)
    weights[term] = 0.0
    return gate, "_WEIGHTS", tuple(weights)


def _without_turns(_movers: Any, groups: Any, motions: Any, *_: Any) -> Any:  # noqa: ANN401
    return turning.rigid_motions(motions[groups])


_WITH_CEILINGS: Final = preset("online").changed({"objects.max_height_m": 100.0})

# Row to what is replaced: owner, name and value.
_RULES: Final[dict[str, tuple[Any, str, Any]]] = {
    "free space": _without_term(1),
    "odds so far": _without_term(2),
    "length of a motion": _without_term(3),
    "thickness": _without_term(4),
    "number of points": _without_term(5),
    "reach above the sensor": _without_term(6),
    "parts move alone less often": _without_term(7),
    "followed before it is called": (gate, "_TENTATIVE", 0.0),
    "views that travel with the sensor": (
        gate,
        "are_travelling_views",
        lambda objects, *_: np.zeros(len(objects), bool),
    ),
    "hidden points count less": (target, "_HIDDEN_M", 0.5),
    "beside the view": (range_view, "_beside", lambda is_seen: np.zeros(is_seen.shape[1], bool)),
    "between the beams": (range_view, "_between", lambda is_seen: np.zeros(len(is_seen), bool)),
    "what is gone": (target.Target, "gone", np.zeros((0, 3), np.float32)),
    "ceilings are no objects": (world_scores, "preset", lambda _: _WITH_CEILINGS),
    "splitting": (object_flow, "split", lambda current, _: current),
    "attachments": (attachments, "attached", lambda *_: np.zeros((2, 0), int)),
    "turning": (turning, "turning", _without_turns),
    "longer steps of fits": (motions, "_OVER_RELAXATION", 1.0),
    "what moves goes on as it did": (motions, "_PRIOR_SCALE", np.inf),
    "preference for fitted motions": (motions, "_NOT_FITTED_SHARE", 1.0),
    "slopes": (GroundSurface, "slopes", lambda _, xyz: np.zeros((len(xyz), 2), np.float32)),
}


def main() -> None:
    """Measures all rows, prints the table, and writes it into a document."""
    parser = make_parser(__doc__)
    add_world_options(parser, (0, 10))
    options = parser.parse_args()
    seeds = range(*options.seeds)
    publish("leave-one-out", _tables(seeds, options.workers, options.cache), options.document)


def _tables(seeds: range, num_workers: int, cache: Path) -> Iterator[Table]:
    worlds = in_processes(_figures, [(seed, cache) for seed in seeds], num_workers)
    means = pd.concat(worlds).groupby(level=0, sort=False).mean()
    rows = [[name, *(f"{value:.3f}" for value in line)] for name, line in means.iterrows()]
    title = f"Random worlds, seeds {seeds[0]} to {seeds[-1]}, means: without"
    yield Table(title, ["", *_FIGURES.values()], rows)


def _figures(seed: int, cache: Path) -> pd.DataFrame:
    """Figures of a world with all rules, and without each."""
    world = kept_world(seed, DURATION_S, "random", cache)
    lines = {}
    for name, rule in {"all rules": None, **_RULES}.items():
        with patch.object(*rule) if rule else nullcontext():
            lines[name] = world_score(world).figures
    return pd.DataFrame(lines).T[list(_FIGURES)].astype(float)


if __name__ == "__main__":
    main()
