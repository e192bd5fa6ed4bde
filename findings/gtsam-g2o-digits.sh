#!/usr/bin/env bash
# SUBJECT  gtsam 4.3.0 (pose graphs), with numpy 2.4.6
# GUESS    readG2o gives back what writeG2o wrote, up to rounding of the last digit of a double.
# SEEN     Numbers are written with six digits, poses, measurements and information alike. In UTM
#          coordinates poses move by up to 5 m (5412345.679 becomes 5.41235e+06), 12 km from the
#          origin by up to 5 cm. A graph at its optimum, with an error of 0, is read back with an
#          error of 190 at 12 km and of 16,000 at UTM coordinates (20 poses, sigmas of 1 cm and
#          1 mrad). No message.
# WHY IT MATTERS
#          g2o is how graphs are handed to other solvers, and how benchmarks are kept. Optimising
#          again restores what the measurements fix, but not the place of the map, and poses that
#          are taken as they are (a prior map, a comparison of solvers by their error) are wrong
#          by metres. Write the file yourself, or subtract an origin before.
# SOURCE   Run below; dataset.cpp of GTSAM prints doubles as a C++ stream does by default.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 120 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
# Without tests and example data, which are 50 MB.
extract='import sys, zipfile; wheel = zipfile.ZipFile(sys.argv[2]); wheel.extractall(
  sys.argv[1], [name for name in wheel.namelist()
                if "/tests/" not in name and not name.startswith("gtsam/Data/")])'
for package in gtsam==4.3.0 numpy==2.4.6; do
  python3 -m pip download --quiet --no-cache-dir --no-deps --dest "$dir/wheel" "$package"
  python3 -c "$extract" "$dir/site" "$dir"/wheel/*.whl
  rm -r "$dir/wheel"
done
PYTHONPATH="$dir/site" python3 -s - "$dir" <<'EOF'
import sys
from importlib.metadata import version

import gtsam
import numpy as np

print("gtsam", version("gtsam"), "numpy", np.__version__)
path = f"{sys.argv[1]}/graph.g2o"
SIGMAS = np.array([0.001, 0.001, 0.001, 0.01, 0.01, 0.01])  # rad and m, of a good odometry


def there_and_back(origin):
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Diagonal.Sigmas(SIGMAS)
    poses = [
        gtsam.Pose3(gtsam.Rot3.Yaw(0.01 * sweep), np.array(origin) + [1.23 * sweep, 0.0, 0.0])
        for sweep in range(20)
    ]
    for key, pose in enumerate(poses):
        values.insert(key, pose)
    for key, (one, other) in enumerate(zip(poses, poses[1:])):
        graph.add(gtsam.BetweenFactorPose3(key, key + 1, one.between(other), noise))
    gtsam.writeG2o(graph, values, path)
    read_graph, read_values = gtsam.readG2o(path, True)
    off = max(
        np.linalg.norm(read_values.atPose3(key).translation() - pose.translation())
        for key, pose in enumerate(poses)
    )
    return off, graph.error(values), read_graph.error(read_values)


for name, origin in {
    "near the origin": (0.0, 0.0, 0.0),
    "12 km away": (12_345.678, 0.0, 100.0),
    "UTM": (512_345.678, 5_412_345.678, 100.0),
}.items():
    off, before, after = there_and_back(origin)
    print(f"{name:16} poses up to {off:.3f} m off, error {before:.0e} before, {after:.3g} after")
    assert before < 1e-12
    if name == "UTM":
        assert 1 < off < 6 and after > 100, "more digits are written now"
    elif name == "12 km away":
        assert 0.01 < off < 0.06 and after > 1, "more digits are written now"
    else:
        assert off < 1e-4
print("as stated: six digits are written")
EOF
