#!/usr/bin/env bash
# SUBJECT  pointcloudset 0.14.0 (sequences of point clouds), bags read with dataset_from_ros;
#          rosbags 0.9.23, pandas 3.1.1
# GUESS    keep_zeros=False, the default, leaves out the points (0, 0, 0) that many drivers send
#          for a missing return. Columns have the names of their fields. A sweep has the time of
#          its header.
# SEEN     A point is left out if any of x, y and z is 0. A cloud of a two-dimensional lidar, in
#          its own plane z = 0, comes out empty. With keep_zeros=True nothing is left out.
#          Fields that are not listed in the order of their offsets get each other's values:
#          with intensity listed first, "intensity" is x, "x" is y, "y" is z. Times are those
#          of recording, rounded to microseconds.
# WHY IT MATTERS
#          Points on an axis (a wall straight ahead at y = 0 of a simulated or gridded sensor)
#          vanish, and frames of a 2-D lidar look like a dead sensor. PointCloud2 prescribes no
#          order of fields. Pass keep_zeros=True, remove (0, 0, 0) yourself, compare the columns.
# SOURCE   Run below; _dataframe_from_message and _get_struct_fmt in io/dataset/ros.py.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 150 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv --without-pip "$dir/venv"
# The module below needs these alone; those of the whole package are several 100 MB.
python3 -m pip --python "$dir/venv/bin/python" install --quiet --no-cache-dir --no-compile \
  --no-deps pointcloudset==0.14.0 rosbags==0.9.23 numpy==2.4.6 pandas==3.1.1 \
  python-dateutil==2.9.0.post0 six==1.17.0 dask==2026.8.0 toolz==1.2.0 cloudpickle==3.1.3 \
  fsspec==2026.9.0 pyyaml==6.0.4 packaging==26.4 partd==1.4.2 locket==1.0.0 \
  importlib-metadata==8.7.0 zipp==3.23.0 rich==15.0.0 pygments==2.21.0 markdown-it-py==4.3.0 \
  mdurl==0.1.2 lz4==4.4.5 zstandard==0.22.0 ruamel.yaml==0.19.1 typing-extensions==4.16.0
"$dir/venv/bin/python" - "$dir" <<'EOF'
import importlib.util
import sys
from importlib.metadata import distribution, version
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

module = distribution("pointcloudset").locate_file("pointcloudset/io/dataset/ros.py")
spec = importlib.util.spec_from_file_location("ros", module)
ros = importlib.util.module_from_spec(spec)
spec.loader.exec_module(ros)
print(*(f"{name} {version(name)}" for name in ("pointcloudset", "rosbags", "pandas")))

store = get_typestore(Stores.ROS2_HUMBLE)
Cloud = store.types["sensor_msgs/msg/PointCloud2"]
Field = store.types["sensor_msgs/msg/PointField"]
Header = store.types["std_msgs/msg/Header"]
Time = store.types["builtin_interfaces/msg/Time"]
OFFSETS = {"x": 0, "y": 4, "z": 8, "intensity": 12}
SECOND, HEADER_NS, BAG_NS = 1_764_345_600, 100_000_000, 123_456_789


def message(points, names):
    data = np.asarray(points, "<f4").tobytes()
    return Cloud(
        header=Header(stamp=Time(sec=SECOND, nanosec=HEADER_NS), frame_id="lidar"),
        height=1, width=len(points), point_step=16, row_step=len(data), is_bigendian=False,
        fields=[Field(name, OFFSETS[name], Field.FLOAT32, 1) for name in names],
        data=np.frombuffer(data, np.uint8), is_dense=True,
    )


def read(title, points, names=tuple(OFFSETS), **options):
    bag = Path(sys.argv[1]) / title.replace(" ", "-")
    with Writer(bag) as writer:
        connection = writer.add_connection("/points", Cloud.__msgtype__, typestore=store)
        data = store.serialize_cdr(message(points, names), Cloud.__msgtype__)
        writer.write(connection, SECOND * 10**9 + BAG_NS, data)
    found = ros.dataset_from_ros(bag, "/points", ext="ROS2", **options)
    frame = found["data"][0].compute()
    print(f"{title}: {len(frame)} of {len(points)} points", frame.to_dict("list"))
    return frame, found["timestamps"][0]


scattered = [(1, 1, 0, 7), (2, 0, 1, 7), (0, 3, 1, 7), (0, 0, 0, 7), (1, 2, 3, 7)]
frame, stamp = read("one coordinate zero", scattered)
assert frame[["x", "y", "z"]].to_numpy().tolist() == [[1, 2, 3]]
print("time", stamp.isoformat())
assert stamp.microsecond == round(BAG_NS / 1000), "of the bag, in microseconds"
assert len(read("kept", scattered, keep_zeros=True)[0]) == len(scattered)

scan = [(np.cos(a), np.sin(a), 0, 7) for a in np.linspace(0.1, 3, 30)]
assert read("two-dimensional lidar", scan)[0].empty

frame, _ = read("intensity listed first", [(1, 2, 3, 7)], ("intensity", "x", "y", "z"))
assert frame[["intensity", "x", "y", "z"]].to_numpy().tolist() == [[1, 2, 3, 7]]
print("as stated: points with one coordinate 0 are left out, columns are named by position")
EOF
