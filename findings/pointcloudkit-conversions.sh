#!/usr/bin/env bash
# SUBJECT  pointcloudkit 0.1.0 (PCD, PLY, LAS), with laspy 2.7.0
# GUESS    convert() keeps what the target format can hold: coordinates to a millimetre (positions
#          are float64 in memory), intensities, other fields, with drop_nan=False all rows.
# SEEN     PCD is written in double precision where a coordinate is above 10 km. One point with NaN
#          disables that check: all others are written in single precision, 16 mm off at
#          x = 600 km (Swiss LV03). Read back from PCD, points with NaN are gone although
#          drop_nan=False says that raw values are kept. LAS is written in steps of 1 cm, an
#          intensity of 0 to 1, as KITTI has it, is cut to the integer 0, and all other fields are
#          lost. PLY keeps everything.
# WHY IT MATTERS
#          Sweeps with missing returns are the rule. A slow mover goes a centimetre or two between
#          sweeps: the steps of both formats become motion. Labels by row (KITTI, SemanticKITTI)
#          go to other points, and time, ring and label are gone in LAS. Convert with PLY.
# SOURCE   Run below; io/pcd.py (abs().max() > 1e4 is False for NaN) and io/las.py (a LasHeader of
#          laspy has scales 0.01).
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 110 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  pointcloudkit==0.1.0 laspy==2.7.0 numpy==2.4.6
cd "$dir"
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import laspy
import numpy as np
from pointcloudkit import PointCloud, convert

print(*(f"{name} {version(name)}" for name in ("pointcloudkit", "laspy", "numpy")))
POSITION = np.array([(600000.017, 200000.004, 410.005), (600000.047, 200000.024, 410.015)])
INTENSITY = np.array([0.35, 0.99], np.float32)
LABEL = np.array([252, 40], np.uint16)
TIME = np.array([1.7e9, 1.7e9 + 0.05])


def cloud(position=POSITION):
    return PointCloud(position.copy(), INTENSITY.copy(), extra={"label": LABEL, "time": TIME})


results = {}
cloud().write("in.ply")
for kind in ("ply", "pcd", "las"):
    convert("in.ply", f"out.{kind}") if kind != "ply" else None
    back = PointCloud.read(f"{'in' if kind == 'ply' else 'out'}.{kind}", drop_nan=False)
    error = np.abs(back.position - POSITION).max() * 1000
    print(f"{kind}: {error:.1f} mm off, intensity {back.intensity.tolist()}, {list(back.extra)}")
    results[kind] = error, back.intensity.tolist(), set(back.extra)

assert results["ply"] == (0, INTENSITY.tolist(), {"label", "time"})
assert results["pcd"] == results["ply"]
assert 3 < results["las"][0] < 5.1 and results["las"][1:] == ([0, 0], set())
assert laspy.read("out.las").header.scales.tolist() == [0.01] * 3

holed = POSITION.copy()
holed[0] = np.nan
for kind, rows in (("ply", 2), ("pcd", 1)):
    cloud(holed).write(f"holed.{kind}")
    back = PointCloud.read(f"holed.{kind}", drop_nan=False)
    error = np.abs(back.position[-1] - POSITION[-1]).max() * 1000
    print(f"{kind}, first point NaN: {len(back)} of 2 points, the last {error:.1f} mm off, label",
          back.extra["label"].tolist())
    assert len(back) == rows, "points with NaN are treated otherwise now"
    assert (14 < error < 17) if kind == "pcd" else error == 0
print("as stated: one NaN makes a PCD file single precision, LAS has steps of 1 cm")
EOF
