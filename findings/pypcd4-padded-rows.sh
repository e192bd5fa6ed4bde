#!/usr/bin/env bash
# SUBJECT  pypcd4 1.5.1 (PCD files and PointCloud2), with rosbags 0.11.9, pointcloud2 0.6.0
# GUESS    PointCloud.from_msg reads any valid sensor_msgs/PointCloud2: padding at the end of
#          rows and big-endian data are handled, or refused.
# SEEN     row_step and is_bigendian are not looked at. A cloud of 2 rows of 4 points, each row
#          padded by one point step, becomes 10 points: two at the origin that nobody measured,
#          while width and height remain 4 and 2. Padded by half a step it becomes 9 points, and
#          x of the second row is what was z. Big-endian x = 1, 2, 3 becomes 4.6e-41, 9e-44,
#          2.3e-41. No error for any of these; only if all padding together is no multiple of the
#          point step there is a ValueError. pointcloud2 0.6.0 reads all of them right.
# WHY IT MATTERS
#          Points at the origin pass filters for NaN, and a nearest-neighbour search near the
#          sensor finds them. Compare points with width * height after reading, or repack first.
# SOURCE   Run below; PointCloud.from_msg in pypcd4.py; definition of sensor_msgs/PointCloud2.
# DATE     2026-11-27
# Needs Python 3.11 or newer. About 140 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  pypcd4==1.5.1 rosbags==0.11.9 pointcloud2==0.6.0 numpy==2.4.6
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import numpy as np
import pointcloud2
import pypcd4
from rosbags.typesys import Stores, get_typestore

print(*(f"{name} {version(name)}" for name in ("pypcd4", "rosbags", "pointcloud2", "numpy")))
types = get_typestore(Stores.ROS2_JAZZY).types
Cloud = types["sensor_msgs/msg/PointCloud2"]
Field = types["sensor_msgs/msg/PointField"]
Header = types["std_msgs/msg/Header"]
Time = types["builtin_interfaces/msg/Time"]
WIDTH, HEIGHT, STEP = 4, 2, 16


def message(padding, *, big):
    kind = ">f4" if big else "<f4"
    points = np.zeros(WIDTH * HEIGHT, [(name, kind) for name in ("x", "y", "z", "intensity")])
    points["x"] = np.arange(1, 9)
    points["y"] = 2.0
    points["z"] = 3.0
    rows = points.reshape(HEIGHT, WIDTH)
    data = b"".join(row.tobytes() + bytes(padding) for row in rows)
    names = ("x", "y", "z", "intensity")
    fields = [Field(name, 4 * i, Field.FLOAT32, 1) for i, name in enumerate(names)]
    return Cloud(
        header=Header(stamp=Time(sec=0, nanosec=0), frame_id="lidar"),
        height=HEIGHT, width=WIDTH, fields=fields, is_bigendian=big, point_step=STEP,
        row_step=WIDTH * STEP + padding, data=np.frombuffer(data, np.uint8), is_dense=True,
    )


def read(cloud):
    other = pointcloud2.read_points(cloud)["x"]
    assert np.array_equal(other, np.arange(1, 9)), "pointcloud2 has changed"
    got = pypcd4.PointCloud.from_msg(cloud)
    print(f"  {got.points} points, {got.metadata.width} x {got.metadata.height}, "
          f"x = {got.pc_data['x'].tolist()}")
    return got


print("no padding, little-endian")
assert read(message(0, big=False)).pc_data["x"].tolist() == list(range(1, 9))
print("rows padded by one point step")
padded = read(message(STEP, big=False))
assert padded.points == 10 != padded.metadata.width * padded.metadata.height
assert padded.numpy(("x", "y", "z"))[[4, 9]].tolist() == [[0, 0, 0]] * 2
print("big-endian")
swapped = read(message(0, big=True))
assert swapped.points == 8 and swapped.pc_data["x"].max() < 1e-38
print("rows padded by half a point step")
shifted = read(message(STEP // 2, big=False))
assert shifted.points == 9 and shifted.pc_data["x"][5:].tolist() == [3.0] * 4  # they are z
print("rows padded by a quarter of a point step")
try:
    read(message(STEP // 4, big=False))
except ValueError as error:
    print(f"  ValueError: {error}")
else:
    raise SystemExit("no error now")
print("as stated: row_step and is_bigendian are not looked at")
EOF
