#!/usr/bin/env bash
# SUBJECT  pyquaternion 0.9.9 (the quaternions of nuScenes and its relatives), with numpy 2.4.6
# GUESS    yaw_pitch_roll are the angles of ISO 8855, as its name and its docstring say: yaw about
#          z, then pitch about the new y, then roll about the new x. Quaternion.distance of two
#          rotations is the angle between them.
# SEEN     The matrix is taken apart in the other order, roll first: Rx(roll) Ry(pitch) Rz(yaw). For
#          a vehicle with yaw 90 and roll 10 degrees it returns pitch 10 and roll 0; with yaw 180
#          the signs of both turn around; (30, 20, 10) comes back as (28.5, 22.2, -1.1). Only with
#          roll and pitch 0 it agrees.
#          distance and sym_distance are half the angle: 20 degrees for rotations 40 degrees apart.
# WHY IT MATTERS
#          Roll and pitch are those about the axes of the map, whichever way the vehicle points: a
#          bank becomes a slope at each crossing, and a level check or a filter of slopes sees a
#          road that changes with the heading. A limit of 10 degrees on distance lets 20 degrees
#          pass. The yaw alone is off by 0.9 degrees at roll 10 and pitch 5. Take rotation_matrix
#          apart by scipy's as_euler("ZYX").
# SOURCE   Run below; the property yaw_pitch_roll, whose docstring names the axes z-y'-x'' and, two
#          lines below, the product in the other order; the class methods distance and sym_distance.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 85 MB and 15 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  pyquaternion==0.9.9 numpy==2.4.6
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import numpy as np
from pyquaternion import Quaternion

print(*(f"{name} {version(name)}" for name in ("pyquaternion", "numpy")))
X, Y, Z = np.eye(3)


def turn(axis, degrees):
    return Quaternion(axis=axis, degrees=degrees)


def returned(yaw, pitch, roll):
    attitude = turn(Z, yaw) * turn(Y, pitch) * turn(X, roll)
    angles = np.rad2deg(attitude.yaw_pitch_roll)
    again = turn(X, angles[2]) * turn(Y, angles[1]) * turn(Z, angles[0])
    assert Quaternion.sym_distance(again, attitude) < 1e-6, "the angles are of another order now"
    print(f"  {(yaw, pitch, roll)} comes back as {angles.round(1).tolist()}")
    return angles


print("yaw, pitch, roll")
assert np.allclose(returned(130, 0, 0), (130, 0, 0))
assert np.allclose(returned(0, 0, 10), (0, 0, 10))
assert np.allclose(returned(90, 0, 10), (90, 10, 0)), "a roll stays a roll now"
assert np.allclose(returned(90, 10, 0), (90, 0, -10)), "a pitch stays a pitch now"
assert np.allclose(returned(180, 5, 10), (179.13, -4.92, -10.04), atol=0.01)
assert np.allclose(returned(30, 20, 10), (28.45, 22.24, -1.12), atol=0.01)
assert np.allclose(returned(0, 5, 10), (-0.87, 4.92, 10.04), atol=0.01)

for name in ("distance", "sym_distance"):
    degrees = np.rad2deg(getattr(Quaternion, name)(turn(Z, 10), turn(Z, 50)))
    print(f"{name} of rotations 40 degrees apart: {degrees:.1f} degrees")
    assert np.isclose(degrees, 20), f"{name} is the whole angle now"
print("as stated: roll first, and half the angle")
EOF
