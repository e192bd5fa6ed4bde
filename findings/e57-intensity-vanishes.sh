#!/usr/bin/env bash
# SUBJECT  e57 0.2.3 (E57 point clouds, in Rust), files by pye57 0.4.19, with numpy 2.4.6
# GUESS    read_points(file).intensity has one row for each point, as it was written.
# SEEN     It does if all points of all scans are valid and have one. One invalid point of 1000, or
#          a second scan without intensity, and the array is empty, (0, 1), for the whole file. No
#          error; pye57 returns the 999 values. Without colours, color holds the
#          intensity three times, while colours of 0 to 255 are returned as 0 to 1: intensities
#          of 0 to 4095 come as colours of 0 to 4095.
# WHY IT MATTERS
#          Terrestrial scanners mark missing returns as invalid, so real files lose what
#          segmentation and registration by intensity need, and synthetic tests do not. A renderer
#          that takes color gets values that are 4095 times too bright. Compare the lengths.
# SOURCE   Run below; read_points of the package.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 140 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  e57==0.2.3 pye57==0.4.19 numpy==2.4.6 pyquaternion==0.9.9
"$dir/venv/bin/python" - "$dir" <<'EOF'
import sys
from importlib.metadata import version

import e57
import numpy as np
import pye57

print(*(f"{name} {version(name)}" for name in ("e57", "pye57", "numpy")))
COUNT = 1000
path = f"{sys.argv[1]}/scans.e57"
number = np.arange(COUNT, dtype=float)
points = {f"cartesian{axis}": number for axis in "XYZ"}
intensity = {"intensity": number % 4096}
grey = {f"color{name}": (number % 256).astype(np.uint8) for name in ("Red", "Green", "Blue")}
one_invalid = {"cartesianInvalidState": (number == 500).astype(np.int8)}


def read(*scans):
    with pye57.E57(path, mode="w") as file:
        for scan in scans:
            file.write_scan_raw(points | scan)
    return e57.read_points(path)


cases = {
    "all valid": read(intensity),
    "one point invalid": read(intensity | one_invalid),
    "second scan without": read(intensity, {}),
    "colours": read(grey),
}
for name, cloud in cases.items():
    print(f"{name:20} points {cloud.points.shape}, intensity {cloud.intensity.shape}, "
          f"color {cloud.color.shape} up to {cloud.color.max(initial=0):g}")
assert np.array_equal(cases["all valid"].intensity[:, 0], intensity["intensity"])
assert cases["one point invalid"].points.shape == (COUNT - 1, 3)
assert cases["one point invalid"].intensity.shape == (0, 1), "intensity is kept now"
assert cases["second scan without"].intensity.shape == (0, 1), "intensity is kept now"
assert np.array_equal(cases["all valid"].color, np.repeat(cases["all valid"].intensity, 3, 1))
assert cases["colours"].color.max() == 1.0

read(intensity | one_invalid)
with pye57.E57(path) as file:
    other = file.read_scan(0, intensity=True)["intensity"]
print("pye57, one point invalid", other.shape)
assert len(other) == COUNT - 1
print("as stated: one invalid point, and no point has an intensity")
EOF
