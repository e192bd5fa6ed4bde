#!/usr/bin/env bash
# SUBJECT  kiss-icp 1.3.0 (loader of ROS bags), with rosbags 0.11.9, numpy 2.4.6
# GUESS    Poses of a run over a bag get the stamps of the clouds' headers.
# SEEN     They get the times at which the clouds were recorded. A driver that stamps the start of
#          a sweep, and a cloud that is recorded 130 ms later, give a trajectory 130 ms late,
#          with the jitter of the recorder: poses of sweeps 100 ms apart lie 80 or 140 ms apart.
#          The package's own loader for a single .mcap file takes the headers (but reads no cloud:
#          with mcap-ros2-support 0.5.0 to 0.6.0 it raises "Unknown datatype code").
# WHY IT MATTERS
#          At 10 m/s the poses are 1.3 m off along the way against a ground truth by GPS time.
#          With a truth of 10 Hz, evo's default limit of 10 ms finds no pairs; with one of 100 Hz it
#          pairs each pose with the truth of a later place, and says nothing. genz-icp 0.3.2
#          has the same code, rko-lio 0.4.0 takes the headers. Replace the stamps by those of the
#          headers before evaluating.
# SOURCE   Run below; RosbagDataset.__getitem__ and McapDataloader.__getitem__.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 110 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip rosbags==0.11.9 numpy==2.4.6 natsort==8.4.0
# Without viewers and command line, which the loaders do not import.
pip --no-deps kiss-icp==1.3.0
"$dir/venv/bin/python" - "$dir" <<'EOF'
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
from kiss_icp.datasets.rosbag import RosbagDataset
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

print(*(f"{name} {version(name)}" for name in ("kiss-icp", "rosbags", "numpy")))
KIND, COUNT = "sensor_msgs/msg/PointCloud2", 6
store = get_typestore(Stores.ROS2_JAZZY)
types = store.types
Cloud, Field = types[KIND], types["sensor_msgs/msg/PointField"]
Header, Time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
sweeps_ns = 1_700_000_000_000_000_000 + 100_000_000 * np.arange(COUNT)
delays_ns = np.array([130, 110, 150, 130, 110, 150]) * 1_000_000  # a sweep takes 100 ms


def cloud(stamp_ns):
    points = np.random.default_rng(0).uniform(-20, 20, (100, 3)).astype("<f4")
    fields = [
        Field(name=name, offset=4 * at, datatype=Field.FLOAT32, count=1)
        for at, name in enumerate("xyz")
    ]
    stamp = Time(sec=int(stamp_ns // 10**9), nanosec=int(stamp_ns % 10**9))
    return Cloud(
        header=Header(stamp=stamp, frame_id="lidar"), height=1, width=100, fields=fields,
        is_bigendian=False, point_step=12, row_step=1200,
        data=np.frombuffer(points.tobytes(), np.uint8), is_dense=True,
    )


bag = Path(sys.argv[1]) / "bag"
with Writer(bag, version=9) as writer:
    connection = writer.add_connection("/points", KIND, typestore=store)
    for stamp, delay in zip(sweeps_ns, delays_ns):
        writer.write(connection, int(stamp + delay), store.serialize_cdr(cloud(stamp), KIND))

dataset = RosbagDataset(bag, topic="/points")
for sweep in range(len(dataset)):
    dataset[sweep]
stamps = np.array(dataset.get_frames_timestamps())
late = stamps - sweeps_ns / 1e9
print("header  ", *(f"{stamp:.3f}" for stamp in sweeps_ns / 1e9))
print("kiss-icp", *(f"{stamp:.3f}" for stamp in stamps))
print(f"late by {late.mean():.3f} s on average, steps {np.diff(stamps).round(3).tolist()}")
assert len(stamps) == COUNT
assert np.allclose(late, delays_ns / 1e9, atol=1e-6), "headers are used now"
del dataset  # closes the bag
print("as stated: poses get the times of recording")
EOF
