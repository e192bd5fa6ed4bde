#!/usr/bin/env bash
# SUBJECT  symforce-sym 0.12.0 (sym.Pose3 of SymForce), with numpy 2.4.6
# GUESS    The tangent of a Pose3 is that of SE(3), as in GTSAM, Sophus or manif: to_tangent is the
#          logarithm, a step of retract is in the body, and interpolate follows the screw.
# SEEN     It is the product of SO(3) and R^3: rotation first, in the body, then the translation,
#          unchanged, in the world. For a pose turned by 90 degrees 10 m ahead and 10 m left
#          to_tangent gives (0, 0, 1.571, 10, 10, 0); the logarithm ends with (15.708, 0, 0). A step
#          of 1 m along x from it moves by 1 m along x of the world. interpolate goes straight: (5,
#          5) in the middle, not (7.07, 2.93).
# WHY IT MATTERS
#          A covariance of a pose has three values in the body and three in the world: read as that
#          of GTSAM's Pose3, whose order is the same, a car that drives north and is unsure along
#          its way is unsure across it. A prior of constant twist by halving tangents cuts the bend.
#          Turn the lower block by the rotation of the pose.
# SOURCE   Run below; sym/ops/pose3/lie_group_ops.py.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 90 MB and 15 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==2.4.6
pip --no-deps symforce-sym==0.12.0
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import numpy as np
import sym

print(*(f"{name} {version(name)}" for name in ("symforce-sym", "numpy")))
EYE = np.eye(6)
left = sym.Rot3.from_yaw_pitch_roll(np.pi / 2, 0, 0)
pose = sym.Pose3(R=left, t=np.array([10.0, 10.0, 0.0]))  # a quarter of a circle of 10 m


def places(name, values, expected, message):
    print(f"{name}: {np.round(np.asarray(values, float), 3).tolist()}")
    assert np.allclose(values, expected, atol=1e-6), message


logarithm = (0, 0, np.pi / 2, 5 * np.pi, 0, 0)
tangent = np.array(pose.to_tangent())
places("tangent", tangent, (0, 0, np.pi / 2, 10, 10, 0), "the tangent is the logarithm now")
assert not np.allclose(tangent, logarithm)
moved = pose.retract(EYE[3])
places("1 m along x", moved.t, (11, 10, 0), "the step is in the body now")
turned = left.inverse() * pose.retract(0.1 * EYE[0]).R
places("turn by 0.1 about x, in the body", turned.to_tangent(), (0.1, 0, 0), "turns in the world")
middle = sym.Pose3.identity().interpolate(pose, 0.5)
places("middle", middle.t, (5, 5, 0), "interpolated on the screw now")

# Unsure by 1 m along its own x, 0.1 m across: what a filter on SE(3) says of this pose.
body = np.diag([0.01, 0.01, 0.01, 1.0, 0.1, 0.1]) ** 2
draws = np.random.default_rng(0).multivariate_normal(np.zeros(6), body, 2000)
spread = np.std([pose.retract(draw).t for draw in draws], axis=0)
print(f"unsure ahead by 1 m, drives along y: {spread.round(2).tolist()} m in x, y, z")
assert spread[0] > 0.9 and spread[1] < 0.15, "the covariance is that of the body now"
print("as stated: rotation in the body, translation in the world")
EOF
