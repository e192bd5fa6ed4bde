#!/usr/bin/env bash
# SUBJECT  ros2-numpy 0.0.5 (PointCloud2 to NumPy and back), with ROS 2 Jazzy's sensor_msgs 5.3.6
# GUESS    numpify(cloud)["intensity"] has the values of the field intensity; x, y, z are found by
#          the offsets of their fields; msgify of points alone is a cloud that others can read.
# SEEN     The number of a field in the list is taken for its offset in bytes, and intensity for
#          uint16: with the fields x, y, z, intensity it is read from bytes 3 and 4, the last byte
#          of x and the first one of y. x = 1, 2, 3 and intensity = 10, 20, 30 (float32) give
#          intensities of 63, 64, 64. xyz are the first twelve bytes whatever the fields say: with
#          the intensity first it becomes x. msgify of points without colour and intensity leaves
#          point_step and row_step at 0. No error for any of these.
# WHY IT MATTERS
#          Intensities look plausible (small integers, nearly constant), and clouds of drivers
#          that do not begin with x are wrong points. Compare with sensor_msgs_py once.
# SOURCE   Run below; ros2_numpy/point_cloud2.py.
# DATE     2026-11-28
# Needs Python 3.10 to 3.14. About 120 MB and a minute.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip ros-jazzy-common-interfaces==5.3.6 'numpy>=1.26,<3' transformations pybase64
# It asks for NumPy 1.24.2, which has no wheels for Python 3.12 and newer.
pip --no-deps ros2-numpy==0.0.5
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import numpy as np
import ros2_numpy
from sensor_msgs.msg import PointCloud2, PointField

print(*(f"{name} {version(name)}" for name in ("ros2-numpy", "ros-sensor-msgs", "numpy")))
POINTS = {"x": [1, 2, 3], "y": [0.5, 0.5, 0.5], "z": [7, 8, 9], "intensity": [10, 20, 30]}


def cloud(*names):
    data = np.zeros(3, [(name, "<f4") for name in names])
    for name in names:
        data[name] = POINTS[name]
    fields = [
        PointField(name=name, offset=4 * row, datatype=PointField.FLOAT32, count=1)
        for row, name in enumerate(names)
    ]
    step = 4 * len(names)
    return PointCloud2(
        height=1, width=3, fields=fields, point_step=step, row_step=3 * step, is_dense=True,
        data=data.tobytes(),
    )


read = ros2_numpy.numpify(cloud("x", "y", "z", "intensity"))
print("intensity", read["intensity"].ravel().tolist(), "of", POINTS["intensity"])
assert read["xyz"][:, 0].tolist() == POINTS["x"]
assert read["intensity"].ravel().tolist() == [63, 64, 64]

other = ros2_numpy.numpify(cloud("intensity", "x", "y", "z"))
print("x", other["xyz"][:, 0].tolist(), "of", POINTS["x"])
assert other["xyz"][:, 0].tolist() == POINTS["intensity"]

written = ros2_numpy.msgify(PointCloud2, {"xyz": np.ones((3, 3), np.float32)})
print("point_step", written.point_step, "row_step", written.row_step, "bytes", len(written.data))
assert (written.point_step, written.row_step, len(written.data)) == (0, 0, 36)
print("as stated: numbers of fields are taken for offsets, points alone get no point_step")
EOF
