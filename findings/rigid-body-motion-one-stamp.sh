#!/usr/bin/env bash
# SUBJECT  rigid-body-motion 0.9.3 (trees of moving frames), with numpy 2.4.6 and scipy 1.17.1
# GUESS    transform_points(points, into, outof, timestamps=...) returns a point for each point,
#          each moved by the pose at its stamp; stamps beyond the poses raise or give NaN.
# SEEN     Points that share one stamp, as those of a sweep do, all become NaN, and so does a single
#          point, even at the stamp of a pose. Two different stamps suffice, and the points are
#          right. Points with stamps before the first pose or after the last are left out: five go
#          in, three come back, without a word. A hole of 58 s in the poses is bridged by a straight
#          line.
# WHY IT MATTERS
#          A cloud in the frame of the robot with the stamp of its header cannot be moved into the
#          map; per-point times can, but at both ends of a drive labels, rings and intensities then
#          belong to other points. Give the pose once per sweep by lookup_transform, or pass
#          return_timestamps=True and join by the stamps.
# SOURCE   Run below; core.py (TransformMatcher.get_timestamps, _resample_array).
# DATE     2026-11-28
# Needs Python 3.11 to 3.14. About 145 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
# Without the tests of numpy and scipy, with which it takes 200 MB.
extract='import sys, zipfile; wheel = zipfile.ZipFile(sys.argv[2]); wheel.extractall(
  sys.argv[1], [name for name in wheel.namelist() if "/tests/" not in name])'
for package in scipy==1.17.1 numpy==2.4.6 numpy-quaternion==2024.0.13 anytree==2.13.0 \
  rigid-body-motion==0.9.3; do
  python3 -m pip download --quiet --no-cache-dir --no-deps --dest "$dir/wheel" "$package"
  python3 -c "$extract" "$dir/site" "$dir"/wheel/*.whl
  rm -r "$dir/wheel"
done
PYTHONPATH="$dir/site" python3 -s - <<'EOF'
import warnings
from importlib.metadata import version

import numpy as np
import rigid_body_motion as rbm

print(*(f"{name} {version(name)}" for name in ("rigid-body-motion", "numpy", "scipy")))
warnings.simplefilter("ignore")  # of a division by zero, below
STAMPS = np.array([0.0, 1.0, 2.0, 60.0])  # s
SPEED = 10.0  # m/s along x
rbm.register_frame("map")
rbm.register_frame(
    "robot",
    parent="map",
    translation=SPEED * STAMPS[:, None] * np.eye(3)[0],
    rotation=np.tile([1.0, 0, 0, 0], (len(STAMPS), 1)),  # w first
    timestamps=STAMPS,
)


def moved(*stamps):
    points = rbm.transform_points(
        np.zeros((len(stamps), 3)), into="map", outof="robot", timestamps=np.array(stamps)
    )
    print(f"stamps {stamps}: x {points[:, 0].tolist()}")
    return points[:, 0]


assert np.allclose(moved(0.5, 1.5), (5, 15))
assert np.isnan(moved(1.5, 1.5, 1.5)).all(), "points with one stamp are moved now"
assert np.isnan(moved(1.0)).all(), "a single point is moved now"
inside = moved(-0.5, 0.5, 1.0, 1.5, 60.5)
assert np.allclose(inside, (5, 10, 15)), "points beyond the poses come back now"
assert np.allclose(moved(2.0, 31.0), (20, 310)), "holes are no longer bridged"
print("as stated: one stamp gives NaN, and points beyond the poses are left out")
EOF
