#!/usr/bin/env bash
# SUBJECT  TrackEval 1.3.0 (evaluation of multi-object tracking): CLEAR's Frag
# GUESS    A track that is lost for two frames and found again is one fragmentation, whatever else
#          is in the scene.
# SEEN     None if the tracker reports nothing at all in the frames between: they are skipped
#          before the state of the tracks is touched. With a second object that is tracked all the
#          time, or with a false alarm far away in the gap, the same track counts one. MOTA, misses
#          and switches are right in all three. py-motmetrics 1.4.0 counted one each time.
# WHY IT MATTERS
#          Sequences with one mover (the usual test drive) get no fragmentation however often the
#          track breaks, and a tracker with false alarms is punished for the gaps of a quiet one.
#          Compare Frag only over frames in which each tracker reports something.
# SOURCE   Run below; eval_sequence in trackeval/metrics/clear.py.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 80 MB and 20 s. TrackEval as a whole would need 400 MB: this
# loads its metric alone, and a search over all assignments in place of scipy's.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==2.4.6
pip --no-deps trackeval==1.3.0
"$dir/venv/bin/python" - <<'EOF'
import importlib
import sys
from importlib.metadata import distribution, version
from itertools import permutations
from types import ModuleType

import numpy as np


def linear_sum_assignment(costs):
    few, many = sorted(costs.shape)
    tall = costs.shape[0] > costs.shape[1]
    table = costs.T if tall else costs
    best = min(permutations(range(many), few), key=lambda choice: table[range(few), choice].sum())
    rows, columns = np.arange(few), np.array(best)
    return (columns, rows) if tall else (rows, columns)


for name in ("scipy", "scipy.optimize", "trackeval", "trackeval.metrics"):
    module = sys.modules[name] = ModuleType(name)
    module.linear_sum_assignment = linear_sum_assignment
    module.__path__ = [str(distribution("trackeval").locate_file(name.replace(".", "/")))]
CLEAR = importlib.import_module("trackeval.metrics.clear").CLEAR
print("trackeval", version("trackeval"), "numpy", np.__version__)

FOUND = (True, True, False, False, True, True)  # the track of object 0, frame by frame


def result(title, others, in_gap_only):
    """others: number of (object, track) pairs or false alarms beside the track of object 0."""
    objects, tracks, similarity = [], [], []
    for found in FOUND:
        beside = others if not (in_gap_only and found) else 0
        seen = [0] * found + [1] * beside
        objects.append(np.array([0] if in_gap_only else [0] + [1] * others))
        tracks.append(np.array(seen, int))
        similarity.append(0.8 * (objects[-1][:, None] == tracks[-1][None, :]))
    got = CLEAR({"PRINT_CONFIG": False}).eval_sequence({
        "num_timesteps": len(FOUND),
        "num_gt_ids": 1 + max(map(max, objects)),
        "num_tracker_ids": 1 + others,
        "num_gt_dets": sum(map(len, objects)),
        "num_tracker_dets": sum(map(len, tracks)),
        "gt_ids": objects,
        "tracker_ids": tracks,
        "similarity_scores": similarity,
    })
    frag, misses, alarms, switches = (int(got[k]) for k in ("Frag", "CLR_FN", "CLR_FP", "IDSW"))
    print(f"{title}: Frag {frag}, misses {misses}, false alarms {alarms}, switches {switches}")
    assert (misses, switches) == (2, 0)
    return frag


assert result("alone", 0, False) == 0, "a lone gap is counted now"
assert result("with a second object", 1, False) == 1
assert result("with false alarms in the gap", 1, True) == 1
print("as stated: the gap counts only if something else is reported in it")
EOF
