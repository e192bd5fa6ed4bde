#!/usr/bin/env bash
# SUBJECT  AHRS 0.4.0 (attitude filters in Python: ahrs.filters), with numpy 2.4.6
# GUESS    The filters of one package, fed with the same samples, converge to the same quaternion:
#          that of the sensor relative to the earth, with one kind of earth axes.
# SEEN     A resting sensor with roll 20, pitch 10 and yaw 30 degrees (x to the magnetic north):
#          Madgwick, Complementary, Fourati, Tilt and FAMC return these angles. AQUA and SAAM return
#          the inverse rotation (-13, -18, -26), Mahony a yaw of 120, FQA a roll of -160 and a yaw
#          of -27. Without a magnetometer, after turning left by 60 degrees: Madgwick, Mahony and
#          EKF 60, AQUA -60, Complementary 0.
# WHY IT MATTERS
#          To compare filters one changes a class name. The inverse of a small tilt looks like
#          noise of opposite sign and halves no error; a heading that is off by 90 degrees looks
#          like a wrong mounting. Turn all into one convention on a synthetic pose first.
# SOURCE   Run below. Mahony takes the y axis of the earth for the horizontal field, the others x.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 85 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile ahrs==0.4.0 numpy==2.4.6
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import numpy as np
from ahrs import filters

print("AHRS", version("ahrs"), "numpy", np.__version__)
RATE_HZ = 100  # the default of all filters


def matrix(quaternion):
    w, x, y, z = quaternion
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def angles(turn):
    """Roll, pitch and yaw in degrees of a rotation matrix."""
    yaw = np.arctan2(turn[1, 0], turn[0, 0])
    return np.rad2deg([np.arctan2(turn[2, 1], turn[2, 2]), -np.arcsin(turn[2, 0]), yaw])


def axis_turn(axis, degrees):
    half = np.deg2rad(degrees) / 2
    return matrix([np.cos(half), *(np.sin(half) * np.eye(3)[axis])])


def check(name, expected, **samples):
    got = angles(matrix(getattr(filters, name)(**samples).Q[-1]))
    print(f"  {name:14} {got.round(1).tolist()}")
    assert np.allclose(got, expected, atol=0.5), f"{name} returns other angles now"


TRUE = (20.0, 10.0, 30.0)
turn = axis_turn(2, TRUE[2]) @ axis_turn(1, TRUE[1]) @ axis_turn(0, TRUE[0])
still = {
    "acc": np.tile(turn.T @ [0, 0, 9.81], (3000, 1)),  # m/s^2
    "mag": np.tile(turn.T @ [20.0, 0, 40], (3000, 1)),  # uT
}
print("resting, true angles", TRUE)
for name in ("Madgwick", "Mahony", "AQUA", "Complementary", "Fourati"):
    expected = {"Mahony": (20, 10, 120), "AQUA": angles(turn.T)}.get(name, TRUE)
    check(name, expected, gyr=np.zeros((3000, 3)), **still)
for name in ("Tilt", "SAAM", "FAMC", "FQA"):
    expected = {"SAAM": angles(turn.T), "FQA": (-160, -10, -26.7)}.get(name, TRUE)
    check(name, expected, **{sensor: samples[:2] for sensor, samples in still.items()})

turning = np.tile([0, 0, np.deg2rad(10)], (6 * RATE_HZ, 1))
level = np.tile([0, 0, 9.81], (6 * RATE_HZ, 1))
print("turned left by 60 degrees, no magnetometer")
YAWS = {"Madgwick": 60, "Mahony": 60, "EKF": 60, "AQUA": -60, "Complementary": 0}
for name, yaw in YAWS.items():
    check(name, (0, 0, yaw), gyr=turning, acc=level)
print("as stated: one attitude, four answers")
EOF
