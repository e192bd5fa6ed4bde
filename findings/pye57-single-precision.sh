#!/usr/bin/env bash
# SUBJECT  pye57 0.4.19 (E57 point clouds), with numpy 2.4.6
# GUESS    write_scan_raw stores coordinates as it gets and returns them, in double precision, and
#          the bounds that it writes hold the points.
# SEEN     They are stored as single floats whatever is given: at a UTM northing of 5,412,345 m a
#          point moves by up to 0.25 m, at an easting of 512,345 m by 16 mm. read_scan returns
#          doubles, so the array looks as before. The bounds are those of two corners after the
#          pose: with a scan turned by 90 degrees xMinimum is 0 and xMaximum is -6.
# WHY IT MATTERS
#          Registered clouds in a map frame, which is what one exports, fall onto a grid of 0.5 m,
#          in a format that is chosen for survey data. Write coordinates of the scanner with
#          rotation and translation, which are stored as doubles, and ignore the bounds.
# SOURCE   Run below; E57.write_scan_raw (a constant is_scaled = False).
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 140 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  pye57==0.4.19 numpy==2.4.6 pyquaternion==0.9.9
"$dir/venv/bin/python" - "$dir" <<'EOF'
import sys
from importlib.metadata import version

import numpy as np
import pye57

print(*(f"{name} {version(name)}" for name in ("pye57", "numpy")))
AXES = ("cartesianX", "cartesianY", "cartesianZ")
path = f"{sys.argv[1]}/scan.e57"


def write_and_read(points, **pose):
    with pye57.E57(path, mode="w") as file:
        file.write_scan_raw(dict(zip(AXES, points.T)), **pose)
    with pye57.E57(path) as file:
        scan = file.read_scan(0, ignore_missing_fields=True)
        header = file.get_header(0)
        bounds = [(getattr(header, f"{axis}Minimum"), getattr(header, f"{axis}Maximum"))
                  for axis in "xyz"]
    return np.column_stack([scan[axis] for axis in AXES]), bounds


local = np.column_stack([0.001 * np.arange(1000), 0.001 * np.arange(1000), np.arange(1000) % 7])
origin = np.array([512_345.0, 5_412_345.0, 100.0])
read, _ = write_and_read(local + origin)
off = np.abs(read - local - origin).max(axis=0)
rows = len(np.unique(read[:, 1]))
print(f"map coordinates: {off.round(4)} m off, {rows} of 1000 northings are left, {read.dtype}")
assert read.dtype == np.float64 and rows < 5 and 0.2 < off[1] <= 0.25, "doubles are stored now"

kept, _ = write_and_read(local, translation=origin)
print(f"scanner coordinates and a translation: {np.abs(kept - local - origin).max():.1e} m off")
assert np.abs(kept - local - origin).max() < 1e-6

half = np.sqrt(0.5)
corners = np.array([[0.0, 0.0, 0.0], [3.0, 6.0, 0.0]])
turned, bounds = write_and_read(corners, rotation=np.array([half, 0, 0, half]))
print("turned by 90 degrees:", turned.round(3).tolist(), "bounds", np.round(bounds, 3).tolist())
assert bounds[0][0] > bounds[0][1], "bounds are in order now"
print("as stated: coordinates are single floats, bounds those of two turned corners")
EOF
