#!/usr/bin/env bash
# SUBJECT  py4dgeo 1.2.0 (registration of point clouds), with numpy 2.4.6
# GUESS    iterative_closest_point(reference, epoch, reduction_point=centre) is what its docstring
#          says: the same result as without the point, with more digits in map coordinates.
# SEEN     The rotation is lost. An epoch turned by 1 degree and shifted by 0.1 m, at UTM
#          coordinates, is registered to 1e-7 m without a reduction point (point i of both is the
#          same place), and is left 0.3 m off with one: a rotation of 1e-7 degrees is found, and
#          nothing is said. Only the means are reduced by the point, not the points: both centred
#          clouds are moved away by it, where they look parallel. Besides, the transformation that
#          is returned is computed without the reduction point and applied with it: near the
#          origin, with a point 2 m from it, 3.5 cm are left.
# WHY IT MATTERS
#          Who follows the advice for large coordinates gets a change map whose "change" is the
#          rotation between two scans, growing with the distance. Subtract an offset from both
#          clouds before, and pass no reduction point.
# SOURCE   Run below; registration._fit_transform and iterative_closest_point.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 100 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==2.4.6 laspy==2.7.0 dateparser==1.5.0 psutil==7.2.2 pooch==1.8.2 requests==2.34.2 \
  xdg==6.0.0
pip --no-deps py4dgeo==1.2.0
"$dir/venv/bin/python" - <<'EOF'
import logging
import sys
from importlib.metadata import version
from importlib.util import find_spec
from types import ModuleType

import numpy as np

# The package itself imports scikit-learn and more; registration and clouds need none of it.
package = ModuleType("py4dgeo")
package.__path__ = find_spec("py4dgeo").submodule_search_locations
sys.modules["py4dgeo"] = package
from py4dgeo.epoch import Epoch  # noqa: E402
from py4dgeo.registration import iterative_closest_point  # noqa: E402

logging.disable(logging.INFO)
print(*(f"{name} {version(name)}" for name in ("py4dgeo", "numpy")))
random = np.random.default_rng(0)
cloud = random.uniform(-10, 10, (4000, 3))
cloud[:2000, 2] = 0.2 * np.sin(cloud[:2000, 0])  # ground, and two walls
cloud[2000:3000, 0] = 9.0
cloud[3000:, 1] = -9.0
angle = np.deg2rad(1.0)
rotation = np.array(
    [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
)
moved = cloud @ rotation.T + [0.1, -0.05, 0.02]


def register(origin, reduction_point):
    epoch = Epoch(moved + origin)
    found = iterative_closest_point(
        Epoch(cloud + origin), epoch, reduction_point=reduction_point
    )
    epoch.transform(found)
    turned = np.rad2deg(np.arctan2(found.affine_transformation[1, 0],
                                   found.affine_transformation[0, 0]))
    return np.linalg.norm(epoch.cloud - cloud - origin, axis=1).max(), turned


utm, local = np.array([512_000.0, 5_412_000.0, 100.0]), np.zeros(3)
cases = {
    "UTM, no reduction point": (utm, None, 0.0, -1.0),
    "UTM, centre of the cloud": (utm, utm + cloud.mean(axis=0), 0.31, 0.0),
    "origin, no reduction point": (local, None, 0.0, -1.0),
    "origin, point 2 m away": (local, np.array([2.0, 0.0, 0.0]), 0.035, -1.0),
}
for name, (origin, point, error, degrees) in cases.items():
    left, turned = register(origin, point)
    print(f"{name:27} {left:.2e} m left, turned by {turned:.7f} degrees of -1")
    assert abs(left - error) < 0.05 and abs(turned - degrees) < 1e-3, name
    assert left < 1e-6 if point is None else left > 0.02, name
print("as stated: with a reduction point the rotation is lost, or applied about another point")
EOF
