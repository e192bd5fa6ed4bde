#!/usr/bin/env bash
# SUBJECT  pypatchworkpp 1.4.1 (Patchwork++, ground segmentation), with numpy 2.4.6
# GUESS    A cloud in the frame of the robot's base, with its ground at z = 0, gives the same ground
#          as the cloud in the sensor's frame, once sensor_height = 0 says where the ground is.
# SEEN     The ground has to lie below the origin of the cloud, and sensor_height does not help. Of
#          a flat ground with noise of 1 cm, all is found at z = -1.723 (sensor's frame), half at
#          z = 0 and 8 % at z = 0.05, with sensor_height 1.723 and 0 alike, and without an error.
# WHY IT MATTERS
#          Drivers and merged clouds are published in base_link or base_footprint, whose origin is
#          on the ground. Half of the ground then counts as obstacle, differently in each sweep.
#          Segment in the sensor's frame, or lower the cloud first (the answer is indices, which
#          need no shift back).
# SOURCE   Run below. A patch is refused unless its normal looks at the origin.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 80 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  pypatchworkpp==1.4.1 numpy==2.4.6
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import numpy as np
import pypatchworkpp

print("pypatchworkpp", version("pypatchworkpp"), "numpy", np.__version__)
HEIGHT = 1.723  # of the sensor above the ground, the default of the package

elevations = np.deg2rad(np.linspace(-25, 3, 64))
azimuths = np.arange(900) * 2 * np.pi / 900
elevation, azimuth = np.meshgrid(elevations, azimuths, indexing="ij")
rays = np.stack(
    [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)],
    axis=-1,
).reshape(-1, 3)
with np.errstate(divide="ignore"):
    to_ground = np.where(rays[:, 2] < 0, -HEIGHT / rays[:, 2], np.inf)
    to_walls = np.minimum(np.abs(20 / rays[:, 0]), np.abs(25 / rays[:, 1]))
sweep = rays * np.minimum(to_ground, to_walls)[:, None]
is_ground = to_ground < to_walls
sweep += np.random.default_rng(0).normal(0, 0.01, sweep.shape)


def found(ground_z, sensor_height):
    parameters = pypatchworkpp.Parameters()
    parameters.sensor_height = sensor_height
    segmentation = pypatchworkpp.patchworkpp(parameters)
    cloud = np.zeros((len(sweep), 4), np.float32)
    cloud[:, :3] = sweep + [0, 0, HEIGHT + ground_z]
    segmentation.estimateGround(cloud)
    return np.mean(np.isin(np.flatnonzero(is_ground), segmentation.getGroundIndices()))


for ground_z, low, high in ((-HEIGHT, 0.99, 1), (-0.2, 0.99, 1), (0, 0.4, 0.7), (0.05, 0, 0.2)):
    shares = [found(ground_z, sensor_height) for sensor_height in (HEIGHT, max(-ground_z, 0))]
    print(f"ground at z = {ground_z}: found {shares[0]:.3f} with the default sensor_height,",
          f"{shares[1]:.3f} with the true one")
    assert all(low <= share <= high for share in shares)
print("as stated: the ground has to lie below the origin")
EOF
