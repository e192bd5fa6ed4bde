#!/usr/bin/env bash
# SUBJECT  kiss-icp 1.3.0 and genz-icp 0.3.2 (lidar odometry), with rosbags 0.11.9, numpy 2.4.6
# GUESS    read_point_cloud, with which their bag and MCAP loaders read PointCloud2, returns points
#          and times of equal length, row i of one belonging to row i of the other.
# SEEN     Points with NaN are taken out, their times are not. Of 1000 points with 500 NaN 500
#          points and 1000 times are returned. Deskewing takes the first 500 times, without a word:
#          points of the second half of the sweep are moved as if they were of the first half. At
#          10 m/s that is 0.5 m on average. If every third point is NaN, it is 0.17 m on average
#          and 0.33 m at the end of the sweep. Without NaN, or if the times are cut as the points
#          are, deskewing is right.
# WHY IT MATTERS
#          Organised clouds (is_dense = false) mark missing returns by NaN: sky, glass, dark cars.
#          The cloud is torn, the odometry still runs, and its figures look like those of a bad
#          sensor. Drop NaN before, or write a loader of your own.
# SOURCE   Run below; tools/point_cloud2.py of both packages. The same function in rko-lio 0.4.0
#          keeps the NaN points, with a remark that the times would have to be cut as well.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 110 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip rosbags==0.11.9 numpy==2.4.6 pydantic-settings==2.15.0 PyYAML==6.0.4
# Without their viewers, which reading and deskewing do not import.
pip --no-deps kiss-icp==1.3.0 genz-icp==0.3.2
"$dir/venv/bin/python" - <<'EOF'
from importlib import import_module
from importlib.metadata import version

import numpy as np
from rosbags.typesys import Stores, get_typestore

print(*(f"{name} {version(name)}" for name in ("kiss-icp", "genz-icp", "rosbags", "numpy")))
COUNT, RANGE, STEP = 1000, 10.0, 1.0  # points, metres, metres that the sensor moves in a sweep
types = get_typestore(Stores.ROS2_JAZZY).types
Cloud, Field = types["sensor_msgs/msg/PointCloud2"], types["sensor_msgs/msg/PointField"]
Header, Time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]


def message(rows):
    names = rows.dtype.names
    fields = [
        Field(name=name, offset=4 * at, datatype=Field.FLOAT32, count=1)
        for at, name in enumerate(names)
    ]
    return Cloud(
        header=Header(stamp=Time(sec=0, nanosec=0), frame_id="lidar"),
        height=1, width=len(rows), fields=fields, is_bigendian=False, point_step=16,
        row_step=16 * len(rows), data=np.frombuffer(rows.tobytes(), np.uint8), is_dense=False,
    )


def sweep():
    azimuth = np.linspace(0, 2 * np.pi, COUNT, endpoint=False)
    rows = np.zeros(COUNT, [(name, "<f4") for name in ("x", "y", "z", "t")])
    rows["x"], rows["y"] = RANGE * np.cos(azimuth), RANGE * np.sin(azimuth)
    rows["t"] = np.arange(COUNT) / (COUNT - 1)  # what both packages take as it is
    return rows


motion = np.eye(4)
motion[0, 3] = STEP
missing = {
    "none": np.zeros(COUNT, bool),
    "every third": np.arange(COUNT) % 3 == 1,
    "first half": np.arange(COUNT) < COUNT // 2,
}
expected = {"none": (0, 0), "every third": (0.166, 0.333), "first half": (0.5, 0.5)}
for package in ("kiss_icp", "genz_icp"):
    read = import_module(f"{package}.tools.point_cloud2").read_point_cloud
    config = import_module(f"{package}.config").load_config(None)
    config.data.deskew = True
    deskew = import_module(f"{package}.preprocess").get_preprocessor(config).preprocess
    points, times = read(message(sweep()))
    right = deskew(points, times, motion)
    assert len(right) == len(points) == len(times) == COUNT
    for case, gone in missing.items():
        rows = sweep()
        rows["x"][gone] = np.nan
        points, times = read(message(rows))
        error = np.linalg.norm(deskew(points, times, motion) - right[~gone], axis=1)
        print(f"{package} NaN {case:12} {len(points):4} points {len(times):4} times, "
              f"deskewed {error.mean():.3f} m off on average, {error.max():.3f} m at most")
        assert len(points) == COUNT - gone.sum() and len(times) == COUNT, "times are cut now"
        assert np.allclose((error.mean(), error.max()), expected[case], atol=0.01), case
        cut = deskew(points, times[~gone], motion)
        assert np.allclose(cut, right[~gone], atol=0.01) or case == "first half"
print("as stated: points with NaN are taken out, their times are not")
EOF
