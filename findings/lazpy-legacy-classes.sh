#!/usr/bin/env bash
# SUBJECT  lazpy 0.9.2 (LAS and LAZ), files by laspy 2.7.0
# GUESS    arrays("classification") and arrays("return_number") of a LAS 1.4 file are the values
#          that laspy reads. A second call returns the same points again.
# SEEN     Of point formats 6 to 10 these names are the fields of the older formats, filled with
#          what fits: classes above 31 become 0, return numbers above 7 become 6 or 7, and the
#          scan angle is in degrees up to 127. The values are under extended_classification,
#          extended_return_number and extended_scan_angle (in 0.006 degrees). arrays() and xyz()
#          go on where the last call ended: after arrays(), xyz() has no points.
# WHY IT MATTERS
#          Class 0 is "never classified", and labels of moving objects are high numbers:
#          SemanticKITTI's 252 to 259, of which 252 to 255 fit the byte of LAS 1.4. A check for
#          movers finds none, without an error. Ask for the extended names, call seek(0).
# SOURCE   Run below; _ARRAY_COLUMNS in lazpy/reader.py; point record formats of LAS 1.4 R15.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 110 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  lazpy==0.9.2 "laspy[lazrs]==2.7.0" lazrs==0.8.2 numpy==2.4.6
cd "$dir"
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import laspy
import lazpy
import numpy as np

print(*(f"{name} {version(name)}" for name in ("lazpy", "laspy", "numpy")))
CLASSES = [2, 31, 32, 64, 252, 255]
RETURNS = [1, 6, 7, 8, 12, 15]

las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
las.x = las.y = las.z = np.arange(6.0)
las.classification = CLASSES
las.return_number = RETURNS
las.number_of_returns = [15] * 6
for name in ("sweep.las", "sweep.laz"):
    las.write(name)
    again = laspy.read(name)
    assert np.array_equal(again.classification, CLASSES)
    assert np.array_equal(again.return_number, RETURNS)

    reader = lazpy.Reader(name)
    arrays = reader.arrays()
    classes, returns = arrays["classification"].tolist(), arrays["return_number"].tolist()
    print(f"{name}: classes {CLASSES} -> {classes}, returns {RETURNS} -> {returns}")
    assert classes == [2, 31, 0, 0, 0, 0], "classes above 31 are read now"
    assert returns[:2] == [1, 6] and max(returns) == 7, "returns above 7 are read now"
    assert set(returns[2:]) <= {6, 7}
    assert arrays["extended_classification"].tolist() == CLASSES
    assert arrays["extended_return_number"].tolist() == RETURNS

    after = len(reader.xyz())
    reader.seek(0)
    print(f"{name}: xyz() after arrays() has {after} points, after seek(0) {len(reader.xyz())}")
    reader.seek(0)
    assert after == 0 and len(reader.xyz()) == len(CLASSES)
print("as stated: classes above 31 are 0 unless asked for by another name")
EOF
