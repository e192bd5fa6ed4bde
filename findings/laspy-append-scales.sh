#!/usr/bin/env bash
# SUBJECT  laspy 2.7.0 (LAS and LAZ files), with numpy 2.4.6
# GUESS    Points appended to a LAS file keep their coordinates: laspy converts them to the
#          scale and offset of the file, as its writer does, or refuses them.
# SEEN     The writer (mode "w") converts. The appender (mode "a") checks only the point format
#          and stores the raw integers, so coordinates are read with the scale and offset of the
#          file: a point at x = 101.000 m comes back at x = 10.000 m. No error, no warning, and
#          the bounding box in the header is consistent with the moved points.
# WHY IT MATTERS
#          Sweeps or map tiles are often written one by one, each with an offset near its own
#          points so that millimetres fit. Appended, every tile but the first lands elsewhere.
#          Call change_scaling(file.header.scales, file.header.offsets) before appending.
# SOURCE   Run below; LasAppender.append_points and LasWriter.write_points in this version.
# DATE     2026-11-27
# Needs Python 3.11 or newer. About 110 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  laspy==2.7.0 numpy==2.4.6
"$dir/venv/bin/python" - "$dir" <<'EOF'
import sys

import laspy
import numpy as np

print("laspy", laspy.__version__, "numpy", np.__version__)


def tile(scale, offset, xyz):
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = [scale] * 3, [offset] * 3
    points = laspy.ScaleAwarePointRecord.zeros(len(xyz), header=header)
    points["x"], points["y"], points["z"] = np.transpose(xyz)
    return header, points


near = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
far = near + 100.0
header, first = tile(0.01, 0.0, near)
_, second = tile(0.001, 100.0, far)


def read(path):
    las = laspy.read(path)
    print(f"  second tile {las.xyz[2:].tolist()}, largest in the header {las.header.maxs}")
    return las.xyz


print("written with mode w, both tiles")
written = f"{sys.argv[1]}/written.las"
with laspy.open(written, "w", header=header) as file:
    file.write_points(first)
    file.write_points(second)
assert np.allclose(read(written), np.vstack([near, far])), "the writer does not convert"

print("second tile appended with mode a")
appended = f"{sys.argv[1]}/appended.las"
with laspy.open(appended, "w", header=header) as file:
    file.write_points(first)
with laspy.open(appended, "a") as file:
    file.append_points(second)
moved = (far - 100.0) / 0.001 * 0.01
got = read(appended)
assert np.allclose(got[:2], near)
assert np.allclose(got[2:], moved), "appended points are no longer moved"

print("the same after change_scaling")
with laspy.open(appended, "w", header=header) as file:
    file.write_points(first)
with laspy.open(appended, "a") as file:
    second.change_scaling(scales=file.header.scales, offsets=file.header.offsets)
    file.append_points(second)
assert np.allclose(read(appended), np.vstack([near, far])), "change_scaling no longer helps"
print("as stated: the appender does not convert, the writer does")
EOF
