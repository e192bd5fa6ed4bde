#!/usr/bin/env bash
# SUBJECT  truckscenes-devkit 1.2.0 (MAN TruckScenes data set), with pypcd4 1.5.1, numpy 2.4.6
# GUESS    LidarPointCloud.subsample(ratio) keeps that share of the points, each at most once,
#          with their time stamps, so subsample(1.0) changes nothing.
# SEEN     Points are drawn with replacement, and only the points: subsample(1.0) on 1000 points
#          leaves 650 different ones (seed 0) in random order, while timestamps stay as they were.
#          subsample(0.5) leaves 500 points and 1000 stamps. Columns i of the two arrays no longer
#          belong together; the next remove_close raises IndexError after 0.5, and nothing after
#          1.0. remove_close itself keeps both arrays together.
# WHY IT MATTERS
#          The stamps of each point are what sets this data set apart from nuScenes, whose devkit
#          has no such array. Deskewing a subsampled cloud moves each point by the ego motion of
#          another time: up to 2.5 m at 25 m/s over a sweep of 0.1 s. Draw indices without
#          replacement, and index both arrays.
# SOURCE   Run below; PointCloud.subsample in truckscenes/utils/data_classes.py.
# DATE     2026-11-27
# Needs Python 3.11 or newer. About 120 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  truckscenes-devkit==1.2.0 pypcd4==1.5.1 pyquaternion==0.9.9 numpy==2.4.6
"$dir/venv/bin/python" - "$dir" <<'EOF'
import sys
from importlib.metadata import version

import numpy as np
import pypcd4
from truckscenes.utils.data_classes import LidarPointCloud

print(*(f"{name} {version(name)}" for name in ("truckscenes-devkit", "pypcd4", "numpy")))
COUNT = 1000
path = f"{sys.argv[1]}/sweep.pcd"
names = ("x", "y", "z", "intensity", "timestamp")
number = np.arange(COUNT)
columns = [
    (10 + 0.01 * number).astype(np.float32),
    np.zeros(COUNT, np.float32),
    np.zeros(COUNT, np.float32),
    number.astype(np.float32),  # tells which point it is
    (1_700_000_000_000_000 + 100 * number).astype(np.uint64),  # microseconds
]
types = (*[np.float32] * 4, np.uint64)
pypcd4.PointCloud.from_points(columns, names, types).save(path)


def sweep():
    cloud = LidarPointCloud.from_file(path)
    assert belong_together(cloud) == 1.0
    return cloud


def belong_together(cloud):
    """Share of the points whose stamp is still in the same column."""
    stamps = cloud.timestamps[0, : cloud.nbr_points()].astype(np.int64)
    return np.mean((stamps - 1_700_000_000_000_000) // 100 == cloud.points[3])


near = sweep()
near.remove_close(12.0)
print(f"remove_close: {near.nbr_points()} points, {near.timestamps.shape[1]} stamps")
assert 0 < near.nbr_points() == near.timestamps.shape[1] < COUNT
assert belong_together(near) == 1.0

for ratio in (1.0, 0.5):
    np.random.seed(0)
    cloud = sweep()
    cloud.subsample(ratio)
    different = len(np.unique(cloud.points[3]))
    share = belong_together(cloud)
    print(f"subsample({ratio}): {cloud.nbr_points()} points, {different} different, "
          f"{cloud.timestamps.shape[1]} stamps, {share:.1%} beside their own stamp")
    assert cloud.nbr_points() == int(COUNT * ratio)
    assert different < 0.85 * cloud.nbr_points(), "drawn without replacement now"
    assert cloud.timestamps.shape[1] == COUNT, "stamps are drawn too now"
    assert share < 0.05, "stamps stay with their points now"
    try:
        cloud.remove_close(1.0)
    except IndexError as error:
        assert ratio == 0.5
        print("  then remove_close: IndexError:", error)
    else:
        assert ratio == 1.0, "no error now"
        print("  then remove_close: no error")
print("as stated: points are drawn with replacement and without their stamps")
EOF
