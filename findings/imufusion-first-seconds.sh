#!/usr/bin/env bash
# SUBJECT  imufusion 1.3.3 (IMU orientation filter), with numpy 2.4.6
# GUESS    Without a magnetometer the heading is the sum of the yaw rates from the first sample on:
#          a start-up phase only weighs the accelerometer more for roll and pitch.
# SEEN     For its first 3 s the filter holds the heading at 0. A sensor that turns at 10 degrees/s
#          has a heading of 0.1 degrees after 3 s and 70.1 instead of 100 degrees after 10 s.
#          After skip_startup() it is 100. The flag startup is set meanwhile; the quaternion looks
#          like that of a sensor at rest.
# WHY IT MATTERS
#          A recording that is cut in motion, or a robot that starts driving at once, loses its
#          first turn: sweeps of these 3 s are deskewed without rotation, and odometry that takes
#          its first heading from the filter is turned by what was lost.
# SOURCE   Run below.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 80 MB and 15 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  imufusion==1.3.3 numpy==2.4.6
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import imufusion
import numpy as np

print("imufusion", version("imufusion"), "numpy", np.__version__)
RATE_HZ = 100  # the default of the filter
TURNING = np.array([0.0, 0.0, 10.0])  # degrees/s
LEVEL = np.array([0.0, 0.0, 1.0])  # g


def heading(filter_, seconds):
    for _ in range(seconds * RATE_HZ):
        filter_.update_no_magnetometer(TURNING, LEVEL)
    return imufusion.quaternion_to_euler(filter_.get_quaternion())[2]


for skip, expected in ((False, (0.1, 70.1)), (True, (30, 100))):
    filter_ = imufusion.Ahrs()
    if skip:
        filter_.skip_startup()
    headings = heading(filter_, 3), heading(filter_, 7)
    print(f"skip_startup {skip}: {headings[0]:.1f} degrees after 3 s, {headings[1]:.1f} after 10 s")
    assert np.allclose(headings, expected, atol=0.2)
print("as stated: the first 3 s of turning are lost")
EOF
