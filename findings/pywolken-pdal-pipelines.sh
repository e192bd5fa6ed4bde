#!/usr/bin/env bash
# SUBJECT  pywolken 0.1.1 ("the Python alternative to PDAL"), with laspy 2.7.0
# GUESS    A pipeline of PDAL runs as in PDAL, or is refused. Reading and writing a LAS file keeps
#          all dimensions of its points.
# SEEN     PDAL's operators && and || end an expression: what follows the first comparison is not
#          looked at. "Classification == 8 && Z > 1" keeps all of class 8, "... || ..." loses the
#          second class. An exponent with a capital E does too: "GpsTime > 1.4E9" compares with
#          1.4. Two ranges of one dimension are joined by AND, where PDAL joins them by OR:
#          "Classification[2:2],Classification[8:8]" keeps nothing. Extra dimensions (ring,
#          reflectance) are read, and left out when written. None of these gives an error.
# WHY IT MATTERS
#          A filter "moving and above ground" (or "this scan and class 8") that lets everything of
#          the class pass looks like a bad classifier, and per-point fields of a lidar are gone
#          after any step. Write AND, OR and 1.4e9; keep extra dimensions yourself.
# SOURCE   Run below; filters/expression.py (match without an end), filters/range.py, io/las.py;
#          PDAL's documentation of expressions and of filters.range.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 110 MB and 20 s. The filters below use nothing of
# SciPy and pyproj (140 MB): empty modules stand in for them.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==2.4.6 laspy==2.7.0
pip --no-deps pywolken==0.1.1
cd "$dir"
"$dir/venv/bin/python" - <<'EOF'
import json
import sys
from importlib.metadata import version
from unittest.mock import MagicMock

import laspy
import numpy as np

for name in ("pyproj", "scipy", "scipy.interpolate", "scipy.ndimage", "scipy.spatial"):
    sys.modules[name] = MagicMock()
import pywolken  # noqa: E402

print(*(f"{name} {version(name)}" for name in ("pywolken", "laspy", "numpy")))
header = laspy.LasHeader(point_format=6, version="1.4")
header.scales = [0.001] * 3
header.add_extra_dim(laspy.ExtraBytesParams("ring", np.uint16))
las = laspy.LasData(header)
las.x = las.y = np.zeros(6)
las.z = [0, 2, 0, 2, 0, 2]
las.classification = [2, 2, 8, 8, 9, 9]
las.gps_time = [1e9, 1e9, 1e9, 1.5e9, 1.5e9, 1.5e9]
las.ring = np.arange(6)
las.write("in.las")


def run(kind, **options):
    stages = ["in.las", {"type": f"filters.{kind}", **options}, "out.las"]
    return pywolken.Pipeline(json.dumps({"pipeline": stages})).execute()


def keep(expression, right):
    count = run("expression", expression=expression)
    print(f"{expression}: {count} points, {right} are right")
    return count


assert keep("Classification == 8 AND Z > 1", 1) == 1
assert keep("Classification == 8 && Z > 1", 1) == 2, "&& is read now"
assert keep("Classification == 8 OR Classification == 9", 4) == 4
assert keep("Classification == 8 || Classification == 9", 4) == 2, "|| is read now"
assert keep("GpsTime > 1.4e9", 3) == 3
assert keep("GpsTime > 1.4E9", 3) == 6, "E is read now"

assert run("range", limits="Classification[8:8]") == 2
try:
    count = run("range", limits="Classification[2:2],Classification[8:8]")
    raise SystemExit(f"two ranges of a dimension keep {count} points now")
except ValueError as error:
    print("Classification[2:2],Classification[8:8]: 0 points, 4 are right:", error)

points = pywolken.read("in.las")
assert points["ring"].tolist() == [0, 1, 2, 3, 4, 5]
pywolken.write(points, "copy.las")
names = set(laspy.read("in.las").point_format.dimension_names)
lost = names - set(laspy.read("copy.las").point_format.dimension_names)
print("dimensions lost between read and write:", lost)
assert lost == {"ring"}
print("as stated: parts of PDAL's expressions and extra dimensions are dropped")
EOF
