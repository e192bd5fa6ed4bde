#!/usr/bin/env bash
# SUBJECT  gtsam 4.3.0 (factor graphs): writeG2o and readG2o
# GUESS    writeG2o followed by readG2o gives the graph back: poses to about 1e-9, all factors.
# SEEN     Numbers are written with six digits. A pose at (543210.123, 5812345.654, 12.346), as in
#          UTM coordinates, is written as 543210, 5.81235e+06, 12.3457 and comes back 4.3 m away;
#          800 m from the origin the error is half a millimetre. Prior factors are left
#          out, so that the graph read back has one factor instead of two and nothing that holds
#          it in place. Neither raises an error or a warning.
# WHY IT MATTERS
#          g2o files carry pose graphs from one SLAM program to the next and into comparisons.
#          Poses of a georeferenced map are moved by metres, more than any loop closure mends, and
#          the optimiser that reads the file fails on a graph without an anchor. Subtract an
#          origin first, and write the priors elsewhere.
# SOURCE   Run below.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 150 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip --no-deps gtsam==4.3.0
rm -r "$dir"/venv/lib/python3*/site-packages/gtsam/Data  # 45 MB of examples
pip numpy==2.4.6
"$dir/venv/bin/python" - "$dir/poses.g2o" <<'EOF'
import sys
from importlib.metadata import version
from pathlib import Path

import gtsam
import numpy as np

print("gtsam", version("gtsam"), "numpy", np.__version__)
path = Path(sys.argv[1])
NOISE = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.01, 0.01, 0.01, 0.1, 0.1, 0.1]))
TURN = gtsam.Rot3.Ypr(0.1234567, 0.2, 0.3)


def written_and_read(origin):
    first = gtsam.Pose3(TURN, np.array(origin))
    step = gtsam.Pose3(TURN, np.array([5.0, 0.0, 0.0]))
    values = gtsam.Values()
    values.insert(0, first)
    values.insert(1, first.compose(step))
    graph = gtsam.NonlinearFactorGraph()
    graph.add(gtsam.PriorFactorPose3(0, first, NOISE))
    graph.add(gtsam.BetweenFactorPose3(0, 1, step, NOISE))
    gtsam.writeG2o(graph, values, str(path))
    print(path.read_text().splitlines()[0])
    graph_back, values_back = gtsam.readG2o(str(path), True)
    error = np.linalg.norm(values_back.atPose3(0).translation() - first.translation())
    print(f"position off by {error:.6f} m, factors {graph.size()} -> {graph_back.size()}")
    assert (graph.size(), graph_back.size()) == (2, 1), "priors are written now"
    return error


assert written_and_read((543210.123456, 5812345.654321, 12.345678)) > 4
assert 4e-4 < written_and_read((123.4564, 789.1235, 12.345678)) < 8e-4
print("as stated: six digits, and no priors")
EOF
