#!/usr/bin/env bash
# SUBJECT  evo 1.38.1 (evaluation of odometry), with numpy 2.4.6
# GUESS    associate_trajectories, and so evo_ape and evo_rpe, match each pose once, as the
#          script of the TUM benchmark does that it follows: a perfect estimate has no relative
#          error.
# SEEN     Each pose of the shorter trajectory gets the nearest one of the longer, however often
#          that one was given before. A reference of 10 Hz over 100 s (1000 poses) and a perfect
#          estimate of 200 Hz over 4 s of it (800) give 160 pairs from 41 poses of the reference,
#          with the default limit of 10 ms. In these pairs the reference stands still and jumps: at
#          10 m/s the relative error per frame is 0.075 m on average and 0.2 m at most. If the
#          estimate covers the whole reference it is the longer one, and the errors are 0.
# WHY IT MATTERS
#          Odometries with an IMU publish at 100 to 400 Hz, and parts of a run are what one looks
#          at. Whether an error is right then depends on which file has more lines. Nothing is
#          printed. Reduce the estimate to the stamps of the reference before, or use the new
#          sync_method "interpolation".
# SOURCE   Run below; core/sync.py.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 150 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
# Only what evo.core imports, without tests: everything that evo lists takes 500 MB.
extract='import sys, zipfile; wheel = zipfile.ZipFile(sys.argv[2]); wheel.extractall(
  sys.argv[1], [name for name in wheel.namelist() if "/tests/" not in name])'
for package in evo==1.38.1 numpy==2.4.6 scipy==1.17.1; do
  python3 -m pip download --quiet --no-cache-dir --no-deps --dest "$dir/wheel" "$package"
  python3 -c "$extract" "$dir/site" "$dir"/wheel/*.whl
  rm -r "$dir/wheel"
done
PYTHONPATH="$dir/site" python3 -s - <<'EOF'
from importlib.metadata import version

import numpy as np
from evo.core import metrics, sync
from evo.core.sync_method import SyncMethod
from evo.core.trajectory import PoseTrajectory3D

print("evo", version("evo"), "numpy", np.__version__)
SPEED = 10.0


def drive(stamps):
    positions = np.zeros((len(stamps), 3))
    positions[:, 0] = SPEED * stamps
    return PoseTrajectory3D(positions, np.tile([1.0, 0, 0, 0], (len(stamps), 1)), stamps)


def evaluate(reference, estimate, method):
    pair = sync.associate_trajectories(reference, estimate, sync_method=method)
    metric = metrics.RPE(metrics.PoseRelation.translation_part)
    metric.process_data(pair)
    used = [len(np.unique(one.timestamps)) for one in pair]
    return pair[0].num_poses, used, metric.error


reference = drive(np.arange(1000) / 10)
estimates = {
    "4 s of the run": drive(20 + np.arange(800) / 200),
    "the whole run": drive(np.arange(20_000) / 200),
}
for name, estimate in estimates.items():
    for method in (SyncMethod.nearest_time, SyncMethod.interpolation):
        count, used, errors = evaluate(reference, estimate, method)
        print(f"{name:15} {method.value:13} {count:4} pairs of {used[0]:4} poses of the "
              f"reference, relative error {errors.mean():.4f} m, at most {errors.max():.4f} m")
        if name == "4 s of the run" and method is SyncMethod.nearest_time:
            assert count > 150 and used[0] < 50, "poses are matched once now"
            assert errors.mean() > 0.05 and errors.max() > 0.15
        else:
            assert used[0] == used[1] == count and errors.max() < 1e-6, name
print("as stated: poses of the longer trajectory are matched several times")
EOF
