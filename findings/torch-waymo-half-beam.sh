#!/usr/bin/env bash
# SUBJECT  torch-waymo 0.2.0 (Waymo Open Dataset without TensorFlow), with numpy 2.4.6
# GUESS    Its points are those of the data set's own converter, to rounding.
# SEEN     Not for the four side lidars, whose beams are given by lowest and highest inclination.
#          The data set takes each row's centre, (row + 0.5) / rows of the range; torch-waymo puts
#          the first row on the lowest and the last on the highest inclination. With 200 rows from
#          -90 to 30 degrees a beam is 0.6 degrees: points are up to half of it off, 0.30 degrees or
#          10 cm at 20 m for the highest, downwards for the lowest, and right in the middle. The
#          lidar on the roof has its beams in a list, and is right.
# WHY IT MATTERS
#          Clouds of roof and sides no longer fit by up to 10 cm where they overlap, which looks
#          like a calibration error, and boxes fitted with one converter are scored on the points
#          of the other. Use the side lidars from the official package, or give the inclinations.
# SOURCE   Run below; converters/geometry.py. compute_inclination in range_image_utils.py of
#          waymo-open-dataset for the formula below.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 90 MB and 15 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==2.4.6
pip --no-deps torch-waymo==0.2.0
"$dir/venv/bin/python" - <<'EOF'
import sys
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import numpy as np

# The packages themselves import PyTorch and pandas; the geometry needs NumPy alone.
folder = Path(next(iter(find_spec("torch_waymo").submodule_search_locations)))
for name, path in (("torch_waymo", folder), ("torch_waymo.converters", folder / "converters")):
    sys.modules[name] = ModuleType(name)
    sys.modules[name].__path__ = [str(path)]
from torch_waymo.converters.geometry import (  # noqa: E402
    beam_inclinations,
    range_image_to_point_cloud,
)

print(*(f"{name} {version(name)}" for name in ("torch-waymo", "numpy")))
ROWS, COLUMNS, RANGE = 200, 600, 20.0
LOWEST, HIGHEST = np.deg2rad(-90.0), np.deg2rad(30.0)


def official():
    """Row 0 is the highest beam."""
    return ((np.arange(ROWS) + 0.5) / ROWS * (HIGHEST - LOWEST) + LOWEST)[::-1]


image = np.full((ROWS, COLUMNS, 4), RANGE, np.float32)
used = beam_inclinations(ROWS, [], LOWEST, HIGHEST)
points, right = (
    range_image_to_point_cloud(image, np.eye(4), inclinations).reshape(ROWS, COLUMNS, 3)
    for inclinations in (used, official())
)
degrees = np.rad2deg(used - official())
metres = np.linalg.norm(points - right, axis=2).max(axis=1)
for row in (0, ROWS // 2, ROWS - 1):
    print(f"row {row:3}: {np.rad2deg(used[row]):7.2f} degrees, official "
          f"{np.rad2deg(official()[row]):7.2f}, points {metres[row]:.3f} m off at {RANGE:g} m")
beam = np.rad2deg(HIGHEST - LOWEST) / ROWS
assert np.allclose(degrees[[0, -1]], [beam / 2, -beam / 2]), "centres are used now"
assert metres[0] > 0.1 and metres[-1] > 0.1 and metres[ROWS // 2] < 0.001

listed = np.sort(np.deg2rad(np.linspace(-17.6, 2.4, 64)))
assert np.array_equal(beam_inclinations(64, listed, 0.0, 0.0), listed[::-1])
print("as stated: uniform beams are up to half a beam off")
EOF
