#!/usr/bin/env bash
# SUBJECT  numpy-quaternion 2024.0.13 (a dtype of quaternions), with numpy 2.4.6 and scipy 1.17.1
# GUESS    q and -q are one rotation wherever rotations are meant: as_rotation_vector gives the
#          short turn, up to 180 degrees, and the mean of two near rotations lies between them.
#          integrate_angular_velocity takes what a gyroscope measures.
# SEEN     The rotation vector of -q is the long way around: -320 degrees for 40. The chordal mean
#          of 10 and 30 degrees is 20, and -160 if one of them has the other sign. slerp does take
#          the short way, so does rotation_intrinsic_distance, not rotor_intrinsic_distance.
#          integrate_angular_velocity and angular_velocity are in the axes of the world: a sensor
#          rolled by 90 degrees that turns about its own z by 57 degrees ends 79 degrees off.
# WHY IT MATTERS
#          Drivers and bags change the sign between two messages, when w passes 0 or at will. A mean
#          mounting or a rate from rotation vectors is then off by half a turn at single stamps.
#          Call unflip_rotors first, which mends a sequence, and turn the rates of a gyroscope by
#          the attitude, which the function hands over with the time.
# SOURCE   Run below; the docstring of integrate_angular_velocity names no frame.
# DATE     2026-11-28
# Needs Python 3.11 to 3.14. About 145 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
# Without the tests of numpy and scipy, with which it takes 200 MB.
extract='import sys, zipfile; wheel = zipfile.ZipFile(sys.argv[2]); wheel.extractall(
  sys.argv[1], [name for name in wheel.namelist() if "/tests/" not in name])'
for package in scipy==1.17.1 numpy==2.4.6 numpy-quaternion==2024.0.13; do
  python3 -m pip download --quiet --no-cache-dir --no-deps --dest "$dir/wheel" "$package"
  python3 -c "$extract" "$dir/site" "$dir"/wheel/*.whl
  rm -r "$dir/wheel"
done
PYTHONPATH="$dir/site" python3 -s - <<'EOF'
import warnings
from importlib.metadata import version

import numpy as np

warnings.simplefilter("ignore")  # that numba is not installed
import quaternion as q  # noqa: E402

print(*(f"{name} {version(name)}" for name in ("numpy-quaternion", "numpy", "scipy")))


def turn(degrees, axis=2):
    return q.from_rotation_vector(np.deg2rad(degrees) * np.eye(3)[axis])


def yaw(rotation):
    return np.rad2deg(q.as_rotation_vector(rotation)[2])


for name, rotation in (("q", turn(40)), ("-q", -turn(40))):
    print(f"rotation vector of {name}: {yaw(rotation):.0f} degrees")
assert np.isclose(yaw(turn(40)), 40) and np.isclose(yaw(-turn(40)), -320), "vectors are short now"

for name, second in (("q", turn(30)), ("-q", -turn(30))):
    pair = np.array([turn(10), second])
    mean = yaw(q.mean_rotor_in_chordal_metric(pair))
    print(f"mean of 10 and 30 degrees, the second as {name}: {mean:.0f} degrees")
    right = np.cos(np.deg2rad(mean - 20))
    assert np.isclose(right, 1 if name == "q" else -1), "the mean is another now"
    mended = yaw(q.mean_rotor_in_chordal_metric(q.unflip_rotors(pair)))
    assert np.isclose(mended, 20), "unflip_rotors mends no sign now"

middle = q.slerp(turn(0), -turn(40), 0, 1, np.array([0.5]))[0]
short = q.rotation_intrinsic_distance(turn(0), -turn(40))
long = q.rotor_intrinsic_distance(turn(0), -turn(40))
print(f"slerp {abs(yaw(middle)):.0f}, distances {np.rad2deg(short):.0f} and {np.rad2deg(long):.0f}")
assert np.isclose(abs(yaw(middle)), 20) and np.allclose(np.rad2deg([short, long]), [40, 320])

rolled, rate = turn(90, axis=0), np.array([0, 0, 1.0])  # rad/s for 1 s
_, attitudes = q.integrate_angular_velocity(lambda time, attitude: rate, 0, 1, R0=rolled)
_, by_body = q.integrate_angular_velocity(
    lambda time, attitude: q.rotate_vectors(attitude, rate), 0, 1, R0=rolled
)
expected = rolled * q.from_rotation_vector(rate)
ends = (attitudes[-1], by_body[-1])
off = [np.rad2deg(q.rotation_intrinsic_distance(end, expected)) for end in ends]
print(f"turned about its own z: {off[0]:.0f} degrees off; {off[1]:.3f} with rates in the world")
assert 78 < off[0] < 80, "rates are those of the body now"
assert off[1] < 0.001
print("as stated: signs count, and rates are in the world")
EOF
