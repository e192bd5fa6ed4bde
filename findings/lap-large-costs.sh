#!/usr/bin/env bash
# SUBJECT  lap 0.5.13 (lapjv, the assignment solver of many trackers), with numpy 2.4.6
# GUESS    lapjv returns the cheapest assignment whatever the unit of the costs.
# SEEN     Only for costs up to about a million. Of 200 random matrices of 2 to 5 rows, scaled to a
#          largest cost of 1e6, 3e6, 1e7 and 1e9, it is dearer than the best one in 0, 13, 32 and
#          38 %, up to 7 times, with no error. With forbidden pairs of 1e9 among costs below 100
#          some answers take one forbidden pair too many; with 1e4 none does. lapjv of lapx 0.9.4,
#          a fork for trackers, did the same.
# WHY IT MATTERS
#          Squared distances in millimetres exceed a million from one metre on, and 1e9 is what a
#          gate writes for "never". Identities are swapped although each cost was right. Use
#          metres, cost_limit (right in all 200 cases) or scipy (right in all).
# SOURCE   Run below, compared with all assignments.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 80 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile lap==0.5.13 numpy==2.4.6
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version
from itertools import permutations

import lap
import numpy as np

print("lap", version("lap"), "numpy", np.__version__)
CASES = 200
GATE = 50.0


def with_lap(costs, **limit):
    _, columns, _ = lap.lapjv(costs, extend_cost=True, **limit)
    return [(row, column) for row, column in enumerate(columns) if column >= 0]


def total(costs, pairs):
    return sum(costs[pair] for pair in pairs)


def cheapest(costs):
    few, many = sorted(costs.shape)
    costs = costs if costs.shape == (few, many) else costs.T
    choices = np.array(list(permutations(range(many), few)))
    return costs[np.arange(few), choices].sum(axis=1).min()


def random_costs(rng):
    return rng.random(rng.integers(2, 6, 2))


for largest in (1e3, 1e6, 3e6, 1e7, 1e9):
    rng = np.random.default_rng(0)
    ratios = np.empty(CASES)
    for case in range(CASES):
        costs = random_costs(rng) * largest
        ratios[case] = total(costs, with_lap(costs)) / cheapest(costs)
    wrong = int(np.sum(ratios > 1 + 1e-9))
    print(f"costs up to {largest:g}: {wrong} of {CASES} wrong, at worst {ratios.max():.1f} times")
    assert wrong > CASES / 20 if largest > 1e6 else wrong == 0

for forbidden in (1e4, 1e9):
    rng = np.random.default_rng(0)
    too_many = wrong_with_limit = 0
    for _ in range(CASES):
        costs = random_costs(rng) * 100
        costs[rng.random(costs.shape) < 0.6] = forbidden
        too_many += total(costs, with_lap(costs)) > cheapest(costs) + forbidden / 2
        gains = np.minimum(costs - GATE, 0)
        limited = total(gains, with_lap(costs, cost_limit=GATE))
        wrong_with_limit += abs(limited - cheapest(gains)) > 1e-9
    print(f"forbidden pairs of {forbidden:g}: {too_many} of {CASES} take one too many;", end=" ")
    print(f"{wrong_with_limit} wrong with cost_limit")
    assert (too_many > 0) == (forbidden == 1e9) and wrong_with_limit == 0
print("as stated: assignments are wrong for costs above a million")
EOF
