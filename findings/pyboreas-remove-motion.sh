#!/usr/bin/env bash
# SUBJECT  asrl-pyboreas 2.0.0 (development kit of the Boreas data set), with numpy 2.4.6
# GUESS    PointCloud.remove_motion moves each point to one time by its own stamp. If the points are
#          not sorted by time it is slower, as its comment says, with the same result.
# SEEN     Sorted, a wall 30 m ahead of a lidar at 20 m/s comes out flat to 0.1 m, with a mean shift
#          of 0.05 m: the stamps are cut to 20 steps, each taken at its beginning. In any other
#          order nothing is moved at all: worker processes move their copies, which are thrown away.
#          random_downsample alone puts the points out of order. For the Aeva lidar nothing is moved
#          either: the last column is taken for the time, and there it holds flags. To them the
#          epoch is added on loading, while the column of times stays relative.
# WHY IT MATTERS
#          The cloud that is returned looks like the one that went in, and so does a correct one at
#          walking speed. Deskewing that does nothing costs 2 m a sweep here. Sort by the last
#          column first; for Aeva bring the times there. Downsample afterwards.
# SOURCE   Run below; data/pointcloud.py, data/sensors.py, utils/utils.py (load_lidar).
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 85 MB and 15 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==2.4.6
pip --no-deps asrl-pyboreas==2.0.0
"$dir/venv/bin/python" - "$dir" <<'EOF'
import sys
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import numpy as np

# Cameras, radar, boxes and pictures are not used here, and need OpenCV, matplotlib and pysteam.
package = ModuleType("pyboreas")
package.__path__ = find_spec("pyboreas").submodule_search_locations
sys.modules["pyboreas"] = package
for name in ("cv2", *("pyboreas." + part for part in (
    "data.bounding_boxes", "utils.radar", "vis.vis_utils"
))):
    sys.modules[name] = ModuleType(name)
    sys.modules[name].__getattr__ = lambda attribute: type(attribute, (), {})
from pyboreas.data.sensors import Aeva, Lidar  # noqa: E402

print(*(f"{name} {version(name)}" for name in ("asrl-pyboreas", "numpy")))
SPEED, WALL, COUNT = 20.0, 30.0, 2000  # m/s, m
RATES = np.array([SPEED, 0, 0, 0, 0, 0]).reshape(6, 1)
times = np.linspace(-0.05, 0.05, COUNT)  # s
seen = np.c_[
    WALL - SPEED * times, np.linspace(-20, 20, COUNT), np.zeros(COUNT), np.full(COUNT, 7.0)
]
order = np.random.default_rng(0).permutation(COUNT)
file = Path(sys.argv[1]) / "1606417239986391.bin"


def stored(sensor, *columns):
    np.column_stack(columns).astype(np.float32).tofile(file)
    frame = sensor(str(file))
    frame.load_data()
    return frame


def distances(name, frame):
    """The mean error and the thickness of the wall before and after."""
    before = np.ptp(frame.points[:, 0])
    frame.remove_motion(RATES)
    errors = frame.points[:, 0] - WALL
    after, mean = np.ptp(errors), errors.mean()
    print(f"{name:12} {before:.2f} m thick, then {after:.2f} m, mean {mean:+.3f} m")
    return before, after, mean


def velodyne(rows=slice(None)):
    return stored(Lidar, seen[rows], np.zeros(COUNT), times[rows])


before, after, mean = distances("sorted", velodyne())
assert before > 1.99 and after < 0.11 and -0.06 < mean < -0.04, "sorted points come out otherwise"
before, after, _ = distances("shuffled", velodyne(order))
assert before == after > 1.99, "shuffled points are moved now"
np.random.seed(0)
frame = velodyne()
frame.random_downsample(0.5)
before, after, _ = distances("downsampled", frame)
assert before == after > 1.9, "downsampled points are moved now"

# x, y, z, radial velocity, intensity, quality, reflectivity, time, flags as a double
flags = np.ones(COUNT).view(np.float32).reshape(COUNT, 2)
frame = stored(Aeva, seen[:, :3], np.zeros((COUNT, 4)), times, flags)
print("Aeva: time", frame.points[0, 7].round(3), "s, flags", frame.points[0, 9].round(3))
assert abs(frame.points[0, 7] + 0.05) < 1e-6 and frame.points[0, 9] > 1.6e9
before, after, _ = distances("Aeva", frame)
assert before == after > 1.99, "points of the Aeva lidar are moved now"
print("as stated: what is not sorted by its last column stays as it was")
EOF
